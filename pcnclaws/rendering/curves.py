"""Curves: the error over the time of a simulation, and the loss over the iterations of a training."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.colors import TABLEAU_COLORS
from matplotlib.figure import Figure

from pcnclaws.atomic import replaced_file

DPI = 150
LOWEST_SHOWN = 1e-7
COLOURS = tuple(TABLEAU_COLORS.values())
AFTER, BEFORE = "tab:blue", "0.45"


class ErrorCurve(NamedTuple):
    """Error of one scene over time.

    label  name of the scene
    time   [s], (frames,)
    mse    squared position error of each frame [m^2], (frames,)
    """

    label: str
    time: Float[np.ndarray, " frames"]
    mse: Float[np.ndarray, " frames"]


class LossCurve(NamedTuple):
    """One quantity over the iterations of a training; values that are not finite are failed checks."""

    iteration: Sequence[int]
    value: Sequence[float]


def error_over_time(after: Sequence[ErrorCurve], path: Path, before: Sequence[ErrorCurve] = ()) -> Path:
    """Error over time of several scenes and their mean, on a logarithmic axis.

    after   curves of the law at hand
    before  the same scenes before training
    """
    figure, axis = _figure()
    if before:
        _draw_curves(axis, before, BEFORE, "before training")
    _draw_curves(axis, after, AFTER, "")
    _decorate(axis, "time [s]", "position error MSE [m²]")
    axis.set_xlim(0.0, 1.02 * max(float(curve.time[-1]) for curve in after) or 1.0)
    highest = max((float(np.nanmax(curve.mse)) for curve in (*after, *before)), default=0.0)
    if highest > 0.0:  # before contact there is nothing but rounding
        axis.set_ylim(bottom=max(axis.get_ylim()[0], LOWEST_SHOWN * highest))
        axis.legend(fontsize=8, frameon=False, loc="lower right")
    else:
        axis.text(0.5, 0.5, "no error in any frame", ha="center", color="0.4", transform=axis.transAxes)
        axis.set_yticks([])
    return _save(figure, path)


def loss_curve(training: LossCurve, path: Path, validation: LossCurve | None = None) -> Path:
    """Training loss over the iterations, and the validation error where it was measured, on a logarithmic axis."""
    figure, axis = _figure()
    axis.plot(training.iteration, _positive(training.value), color=COLOURS[0], linewidth=0.6, alpha=0.35)
    smooth, centre = _running_median(np.asarray(training.value, dtype=float))
    iteration = np.asarray(training.iteration)[centre]
    axis.plot(iteration, _positive(smooth), color=COLOURS[0], linewidth=1.6, label="training loss (segments)")
    if validation is not None and len(validation.value):
        axis.plot(
            validation.iteration,
            _positive(validation.value),
            "o-",
            color=COLOURS[1],
            markersize=4.5,
            linewidth=1.2,
            label="validation MSE (whole trajectories)",
        )
    _decorate(axis, "iteration", "MSE [m²]")
    axis.legend(fontsize=8, frameon=False)
    return _save(figure, path)


def _draw_curves(axis: Axes, curves: Sequence[ErrorCurve], colour: str, when: str) -> None:
    """A thin line for each scene and a thick one for their mean; the worst scene has its name at its end."""
    several = len(curves) > 1
    words = [f"each of {len(curves)} scenes" if several else curves[0].label, *([when] if when else [])]
    for number, curve in enumerate(curves):
        style: dict[str, Any] = {"linewidth": 0.7, "alpha": 0.55} if several else {"linewidth": 1.8}
        label = None if number else ", ".join(words)
        axis.plot(curve.time, _positive(curve.mse), color=colour, label=label, **style)
    if not several:
        return
    if all(np.array_equal(curve.time, curves[0].time) for curve in curves):
        label = ", ".join(["mean", *words[1:]])
        mean = np.mean([curve.mse for curve in curves], axis=0)
        axis.plot(curves[0].time, _positive(mean), color=colour, linewidth=2.2, label=label)
    worst = max(curves, key=lambda curve: float(np.nan_to_num(curve.mse[-1])))
    if worst.mse[-1] > 0.0:
        place = (float(worst.time[-1]), float(worst.mse[-1]))
        axis.annotate(worst.label, place, (-2, 4), textcoords="offset points", ha="right", fontsize=7, color=colour)


def _running_median(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Median over a window of a twentieth of the values, and the index of each window's middle."""
    window = max(1, len(values) // 20)
    middles = np.arange(window // 2, max(len(values) - (window - 1) // 2, window // 2 + 1))
    spans = [values[max(0, m - window // 2) : m + (window + 1) // 2] for m in middles]
    return np.array([np.median(span) if len(span) else np.nan for span in spans]), middles


def _positive(values: Sequence[float] | np.ndarray) -> np.ndarray:
    """NaN in place of what a logarithmic axis cannot show, such as the zero error of the first frame."""
    array = np.asarray(values, dtype=float)
    return np.where(np.isfinite(array) & (array > 0.0), array, np.nan)


def _figure() -> tuple[Figure, Axes]:
    figure = Figure(figsize=(6.4, 3.8), dpi=DPI, layout="constrained")
    return figure, figure.subplots()


def _decorate(axis: Axes, horizontal: str, vertical: str) -> None:
    axis.set_xlabel(horizontal)
    axis.set_ylabel(vertical)
    axis.set_yscale("log")
    axis.grid(True, which="major", color="0.9")
    axis.spines[["top", "right"]].set_visible(False)


def _save(figure: Figure, path: Path) -> Path:
    with replaced_file(path) as unfinished:
        figure.savefig(unfinished, format=path.suffix[1:], dpi=DPI)
    return path
