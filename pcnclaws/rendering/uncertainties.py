"""Pictures of uncertainty: profiles of the likelihood, and samples of a posterior."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pcnclaws.atomic import replaced_file
from pcnclaws.rendering.labels import axis_label

DPI, WIDTH, HEIGHT, COLUMNS = 150, 3.2, 2.6, 3
PROFILE, LINEAR = "tab:blue", "0.55"
TRUE_LINE: dict[str, Any] = {"color": "tab:red", "linestyle": "--", "linewidth": 1.0}
# Chi-squared of one degree of freedom that 95 % do not reach, and how much of the curve above it is shown.
LIMIT, SHOWN = 3.841458820694124, 2.2


class ProfilePanel(NamedTuple):
    """The profile of one unknown.

    values, deviance  its points, in its unit and [-]
    interval          of 95 %, where the profile passes the limit
    linear            that of the linear problem
    truth             None where it is not known
    """

    label: str
    values: Sequence[float]
    deviance: Sequence[float]
    interval: tuple[float, float]
    linear: tuple[float, float]
    truth: float | None


def profile_picture(panels: Sequence[ProfilePanel], title: str, path: Path) -> Path:
    """A panel for each unknown: the profile, the parabola of the linear problem, and both intervals."""
    columns = min(len(panels), COLUMNS)
    rows = -(-len(panels) // columns)
    figure = Figure(figsize=(columns * WIDTH, rows * HEIGHT + 0.4), dpi=DPI, layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for axis, panel in zip(axes, panels, strict=False):
        _draw(axis, panel)
    for axis in axes[len(panels) :]:
        axis.set_visible(False)
    axes[0].set_ylabel("deviance [-]", fontsize=8)
    axes[0].legend(fontsize=7, frameon=False, loc="upper center")
    figure.suptitle(title, fontsize=10)
    return _saved(figure, path)


def posterior_picture(
    labels: Sequence[str],
    values: Float[np.ndarray, "samples unknowns"],
    truth: Mapping[str, float],
    title: str,
    path: Path,
) -> Path:
    """Histograms of the unknowns, and the samples of each pair of them."""
    count = len(labels)
    size = max(1.7 * count + 0.8, 3.5)
    figure = Figure(figsize=(size, size), dpi=DPI, layout="constrained")
    axes = figure.subplots(count, count, squeeze=False)
    shown = [_scale(label) * column for label, column in zip(labels, values.T, strict=True)]
    true = [_scale(label) * truth[label] if label in truth else None for label in labels]
    for row in range(count):
        for column in range(count):
            axis = axes[row, column]
            axis.set_visible(column <= row)
            axis.tick_params(labelsize=6, labelbottom=row == count - 1, labelleft=column == 0 and row > 0)
            if column == row:
                _draw_histogram(axis, shown[row], true[row])
            elif column < row:
                _draw_pair(axis, (shown[column], shown[row]), (true[column], true[row]))
        axes[count - 1, row].set_xlabel(_axis_name(labels[row]), fontsize=7)
        if row:
            axes[row, 0].set_ylabel(_axis_name(labels[row]), fontsize=7)
    figure.suptitle(title, fontsize=9)
    return _saved(figure, path)


def _draw_histogram(axis: Axes, values: np.ndarray, true: float | None) -> None:
    axis.hist(values, bins=30, color=PROFILE, histtype="stepfilled", alpha=0.4)
    for end in np.quantile(values, (0.025, 0.975)):
        axis.axvline(end, color=PROFILE, linewidth=1.0)
    if true is not None:
        axis.axvline(true, **TRUE_LINE)
    axis.set_yticks([])


def _draw_pair(axis: Axes, values: tuple[np.ndarray, np.ndarray], true: tuple[float | None, float | None]) -> None:
    axis.plot(*values, ".", color=PROFILE, markersize=1.5, alpha=0.3, rasterized=True)
    for place, line in zip(true, (axis.axvline, axis.axhline), strict=True):
        if place is not None:
            line(place, **TRUE_LINE)


def _axis_name(label: str) -> str:
    name, _, component = label.partition("[")
    return f"{axis_label(name)[0]} {component.removesuffix(']').replace('_', ' ')}".strip()


def _scale(label: str) -> float:
    return axis_label(label.partition("[")[0])[1]


def _draw(axis: Axes, panel: ProfilePanel) -> None:
    scale = _scale(panel.label)
    values, deviance = scale * np.asarray(panel.values), np.asarray(panel.deviance)
    shown = np.isfinite(deviance)
    axis.plot(values[shown], deviance[shown], ".-", color=PROFILE, linewidth=1.2, label="profile")
    low, high = (scale * end for end in panel.linear)
    if np.isfinite(high - low):
        best = float(values[np.argmin(deviance)])
        place = np.linspace(min(values[0], low), max(values[-1], high), 401)
        reach = np.where(place < best, best - low, high - best)
        axis.plot(place, LIMIT * np.square((place - best) / reach), ":", color=LINEAR, label="linear problem")
    axis.axhline(LIMIT, color=LINEAR, linewidth=0.8)
    axis.axvspan(*(scale * end for end in panel.interval), color=PROFILE, alpha=0.12, linewidth=0.0)
    if panel.truth is not None:
        axis.axvline(scale * panel.truth, label="truth", **TRUE_LINE)
    margin = 0.15 * (values[-1] - values[0])
    axis.set_xlim(values[0] - margin, values[-1] + margin)
    axis.set_ylim(-0.2, SHOWN * LIMIT)
    axis.set_xlabel(_axis_name(panel.label), fontsize=8)
    axis.tick_params(labelsize=7)
    axis.grid(True, color="0.92")
    axis.spines[["top", "right"]].set_visible(False)


def _saved(figure: Figure, path: Path) -> Path:
    with replaced_file(path) as unfinished:
        figure.savefig(unfinished, format=path.suffix[1:], dpi=DPI)
    return path
