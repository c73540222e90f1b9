"""Curves: the error over the time of a simulation, and the loss over the iterations of a training."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.colors import TABLEAU_COLORS
from matplotlib.figure import Figure

from pcnclaws.data.atomic import replaced_file

DPI = 150
LOWEST_SHOWN = 1e-9
COLOURS = (*TABLEAU_COLORS.values(), "black", "navy")  # one for each of twelve scenes


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
    """Error over time of several scenes, on a logarithmic axis.

    after   curves of the law at hand
    before  the same scenes before training, drawn thin and dashed in the same colours
    """
    figure, axis = _figure()
    colour = {curve.label: COLOURS[k % len(COLOURS)] for k, curve in enumerate(after)}
    for curve in before:
        axis.plot(curve.time, _positive(curve.mse), "--", color=colour.get(curve.label, "0.5"), linewidth=1.0)
    for curve in after:
        axis.plot(curve.time, _positive(curve.mse), color=colour[curve.label], linewidth=1.8, label=curve.label)
    if before:
        axis.plot([], [], "--", color="0.4", linewidth=1.0, label="before training")
    _decorate(axis, "time [s]", "position error MSE [m²]")
    axis.set_xlim(0.0, 1.02 * max(float(curve.time[-1]) for curve in after) or 1.0)
    highest = max((float(np.nanmax(curve.mse)) for curve in (*after, *before)), default=0.0)
    if highest > 0.0:  # before contact there is nothing but rounding
        axis.set_ylim(bottom=max(axis.get_ylim()[0], LOWEST_SHOWN * highest))
    else:
        axis.text(0.5, 0.5, "no error in any frame", ha="center", color="0.4", transform=axis.transAxes)
        axis.set_yticks([])
    axis.legend(fontsize=8, frameon=False, ncols=1 + (len(after) > 6))
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
