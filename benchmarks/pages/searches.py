"""The picture of how searches come down to their estimates, drawn from the JSON files of estimates alone."""

import math
from collections.abc import Mapping
from pathlib import Path

from matplotlib.figure import Figure

from benchmarks.charts import DPI, decorate, save
from benchmarks.pages.documents import Document

WAYS = {"pretrained_unscreened": "Gauss-Newton", "adam": "Adam"}
COLUMNS = 3


def compared_searches(by_object: Mapping[str, Mapping[str, Document]]) -> dict[str, Mapping[str, Document]]:
    """The objects that were searched for in both ways, with their courses."""
    return {
        name: ways for name, ways in by_object.items() if all(way in ways and "history" in ways[way] for way in WAYS)
    }


def searches_picture(searches: Mapping[str, Mapping[str, Document]], path: Path) -> Path:
    """Error over the iterations of both ways, a panel an object."""
    rows = math.ceil(len(searches) / COLUMNS)
    figure = Figure(figsize=(9.0, 2.2 * rows + 0.4), dpi=DPI, layout="constrained")
    axes = figure.subplots(rows, COLUMNS, squeeze=False, sharex=True, sharey=True)
    for axis in axes.flat[len(searches) :]:
        axis.set_visible(False)
    for axis, (name, ways) in zip(axes.flat, searches.items(), strict=False):
        for way, label in WAYS.items():
            errors = [one["mse"] for one in ways[way]["history"]]
            axis.plot(range(len(errors)), errors, label=f"{label}, {ways[way]['seconds']:.0f} s")
        axis.set_title(name.replace("_", " "), fontsize=9)
        axis.set_xscale("symlog", linthresh=10.0)
        axis.set_xlim(left=0.0)
        axis.set_yscale("log")
        decorate(axis, "iteration", "MSE [m²]")
        axis.label_outer()
        axis.legend(fontsize=7, frameon=False)
    return save(figure, path)
