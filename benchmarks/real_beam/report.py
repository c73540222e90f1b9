"""Tables and pictures of the measured beam, from the result document alone."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from rich.table import Table

from benchmarks.charts import COLOURS, decorate, panels, save, table_of

Row = Mapping[str, Any]
MEASURED, OURS, FITTED = "0.25", COLOURS[0], COLOURS[1]


def tables(document: Mapping[str, Any]) -> list[Table]:
    """Estimates; measured beside fitted and predicted."""
    results = document["results"]
    estimates = table_of("estimates", "parameter", "estimate", "95 % from", "to")
    for name, row in results["fit"]["parameters"].items():
        low, high = row["interval_95"]
        estimates.add_row(name, f"{row['estimate']:.5g}", f"{low:.5g}", f"{high:.5g}")
    motions = table_of("differences", "motion", "sag", "frequency", "RMS over amplitude")
    for words, name in (("bare, fitted", "bare"), ("52 g, predicted", "predicted"), ("52 g, fitted", "loaded")):
        off = results[name]["differences"]
        motions.add_row(words, f"{off['sag']:+.1%}", f"{off['frequency']:+.1%}", f"{off['rms']:.1%}")
    return [estimates, motions]


def draw_motions(results: Mapping[str, Any], path: Path) -> Path:
    """Height of the tip over time: fitted, predicted, and to be measured."""
    figure, axes = panels(3, 13.0, 4.0)
    _motion(axes[0], results["bare"], "fitted: its own weight")
    _motion(axes[1], results["predicted"], "predicted: 52 g")
    again = results["loaded"]["curve"]
    axes[1].plot(
        again["time"], _millimetres(again["simulated"]), color=FITTED, linewidth=0.8, label="fitted afterwards"
    )
    turned = results["turned"]["curve"]
    axes[1].plot(
        turned["time"], _millimetres(turned["simulated"]), ":", color=OURS, linewidth=0.9, label="first turn read off"
    )
    heavy = results["heavy"]["curve"]
    axes[2].fill_between(
        heavy["time"],
        _millimetres(heavy["low"]),
        _millimetres(heavy["high"]),
        color=OURS,
        alpha=0.25,
        label="90 % band",
    )
    axes[2].plot(heavy["time"], _millimetres(heavy["middle"]), color=OURS, linewidth=1.0, label="predicted")
    axes[2].set_title("predicted: 101 g")
    for axis in axes:
        decorate(axis, "time [s]", "height of the first marker [mm]")
        axis.set_xlim(0.3, 3.5)
        axis.legend(frameon=False)
    return save(figure, path)


def draw_convergence(results: Mapping[str, Any], path: Path) -> Path:
    """Sag and frequency over the cells of the grid, relative to those of the finest."""
    figure, axes = panels(2, 9.0, 3.4)
    for load, colour in (("0 g", COLOURS[0]), ("52 g", COLOURS[1])):
        rows = {int(name.split()[0]): row for name, row in results["convergence"].items() if name.endswith(f", {load}")}
        for axis, what in zip(axes, ("sag", "frequency"), strict=True):
            finest = rows[max(rows)][what]
            axis.plot(
                [*rows], [1e2 * (row[what] / finest - 1.0) for row in rows.values()], "o-", color=colour, label=load
            )
    for axis, what in zip(axes, ("sag", "frequency"), strict=True):
        decorate(axis, "cells over the width", f"{what} relative to the finest grid [%]")
        axis.legend(frameon=False)
    return save(figure, path)


def _motion(axis: Axes, row: Row, title: str) -> None:
    curve = row["curve"]
    axis.plot(curve["time"], _millimetres(curve["measured"]), color=MEASURED, linewidth=1.2, label="measured")
    axis.plot(curve["time"], _millimetres(curve["simulated"]), color=OURS, linewidth=0.9, label=title.split(":")[0])
    axis.set_title(title)


def _millimetres(values: list[float]) -> list[float]:
    return [1e3 * value for value in values]
