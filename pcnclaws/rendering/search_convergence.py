"""The picture of an estimation: every unknown and the error over the iterations."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pcnclaws.atomic import replaced_file
from pcnclaws.rendering.labels import axis_label

DPI, WIDTH, HEIGHT, COLUMNS = 150, 3.2, 2.4, 3
SEARCH, TRUTH = "tab:blue", "tab:red"


class Course(NamedTuple):
    """One unknown over the iterations.

    name      of the parameter, with its component in brackets
    values    in its unit, (iterations,)
    interval  of 95 % at the end, None where it is not known
    truth     None where it is not known
    """

    name: str
    values: Sequence[float]
    interval: tuple[float, float] | None
    truth: float | None


def convergence(courses: Sequence[Course], mse: Sequence[float], title: str, path: Path) -> Path:
    """A panel for each unknown, and one for the mean squared error [m^2] on a logarithmic axis."""
    count = len(courses) + 1
    columns = min(count, COLUMNS)
    rows = -(-count // columns)
    figure = Figure(figsize=(columns * WIDTH, rows * HEIGHT + 0.4), dpi=DPI, layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for axis, course in zip(axes, courses, strict=False):
        _draw(axis, course)
    shown = np.asarray(mse, dtype=float)
    axes[count - 1].plot(np.where(np.isfinite(shown) & (shown > 0.0), shown, np.nan), ".-", color=SEARCH, linewidth=1.2)
    axes[count - 1].set_yscale("log")
    axes[count - 1].set_ylabel("position error MSE [m²]", fontsize=8)
    for axis in axes[count:]:
        axis.set_visible(False)
    for axis in axes[:count]:
        axis.set_xlabel("iteration", fontsize=8)
        axis.tick_params(labelsize=7)
        axis.grid(True, color="0.92")
        axis.spines[["top", "right"]].set_visible(False)
    axes[0].legend(fontsize=7, frameon=False)
    figure.suptitle(title, fontsize=10)
    with replaced_file(path) as unfinished:
        figure.savefig(unfinished, format=path.suffix[1:], dpi=DPI)
    return path


def _draw(axis: Axes, course: Course) -> None:
    name, _, component = course.name.partition("[")
    label, scale = axis_label(name)
    axis.plot(scale * np.asarray(course.values), ".-", color=SEARCH, linewidth=1.2, label="search")
    if course.interval is not None:
        low, high = (scale * end for end in course.interval)
        axis.axhspan(low, high, color=SEARCH, alpha=0.15, linewidth=0.0, label="95 % interval")
    if course.truth is not None:
        axis.axhline(scale * course.truth, color=TRUTH, linestyle="--", linewidth=1.0, label="truth")
    axis.set_ylabel(f"{label} {component.removesuffix(']').replace('_', ' ')}".strip(), fontsize=8)
