"""The error over time of all methods, drawn from the JSON files alone."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.charts import COLOURS, DPI, decorate, save
from benchmarks.pages.cells import title, words
from benchmarks.pages.documents import Document, Results, Row
from benchmarks.pages.published import PAPER_MATERIALS

# Rows in the order of the table, and what they are called.
METHODS = {
    "analytic": "analytic law, true parameters",
    "identified": "analytic law, identified",
    "spline": "Spline",
    "gns": "GNS",
    "nclaws": "NCLaws",
    "single": "-S",
    "multi": "-M",
}
# Errors over twice the length of the training motion, and at parameters that were not trained on.
SHOWN = ("long_term", "unseen")
# The axis spans so many powers of ten below the largest error: what is less is rounding.
DECADES = 12


def draw_comparison(results: Results, path: Path) -> Path | None:
    """One panel for each material and task, a line for each method; None without any curve."""
    materials = [name for name in PAPER_MATERIALS if any(_curves(results.get(name, {}), task) for task in SHOWN)]
    if not materials:
        return None
    figure = Figure(figsize=(1.0 + 3.6 * len(materials), 6.4), dpi=DPI, layout="constrained")
    axes = np.asarray(figure.subplots(len(SHOWN), len(materials), squeeze=False))
    for line, task in enumerate(SHOWN):
        for column, material in enumerate(materials):
            _draw(axes[line, column], _curves(results[material], task))
            axes[line, column].set_title(f"{title(material)}, {words(task)}", fontsize=10)
    named = {label: line for axis in axes.flat for line, label in zip(*axis.get_legend_handles_labels(), strict=True)}
    order = [label for label in METHODS.values() if label in named]
    figure.legend([named[label] for label in order], order, loc="outside lower center", ncols=4, fontsize=9)
    return save(figure, path)


def _curves(rows: Mapping[str, Row], task: str) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Time [s] and mean error [m^2] of the scenes of a task, by method."""
    found = {}
    for method in METHODS:
        document = rows[method].tasks.get(task) if method in rows else None
        if document is not None and (curve := _mean_curve(document)) is not None:
            found[method] = curve
    return found


def _mean_curve(document: Document) -> tuple[np.ndarray, np.ndarray] | None:
    """Scenes that diverged have no curve."""
    curves = [scene for scene in document.get("scenes", []) if scene.get("mse_by_frame")]
    if not curves:
        return None
    time = np.array(curves[0]["time"])
    same = [np.array(scene["mse_by_frame"], dtype=float) for scene in curves if len(scene["time"]) == len(time)]
    return time, np.mean(same, axis=0)


def _draw(axis: Axes, curves: Mapping[str, tuple[np.ndarray, np.ndarray]]) -> None:
    for method, (time, mse) in curves.items():
        positive = np.where(mse > 0.0, mse, np.nan)
        colour = COLOURS[list(METHODS).index(method)]
        axis.plot(time, positive, color=colour, linewidth=1.5, label=METHODS[method])
    largest = max((float(np.nanmax(mse)) for _, mse in curves.values()), default=0.0)
    decorate(axis, "time [s]", "position error MSE [m²]")
    if largest > 0.0:
        axis.set_yscale("log")
        axis.set_ylim(largest * 10.0**-DECADES, 3.0 * largest)
