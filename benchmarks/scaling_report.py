"""The tables and the picture of the cost over particles, scenes and threads."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from rich.markup import escape
from rich.table import Table

from benchmarks.charts import COLOURS, decorate, mark, panels, save, table_of

# What the cost is measured over, and the words for it; rows are lists in the document by these names.
CURVES = {"particles": "particles of one body, 8 a cell", "scenes": "scenes in the batch", "threads": "threads"}
UNIT = "ms per 1000 particles and step"


def tables(document: Mapping[str, Any]) -> list[Table]:
    """One table a curve, with the cost over the least of the curve, or the gain for threads."""
    results = document["results"]
    return [_table(curve, results[curve]) for curve in CURVES if results[curve]]


def draw(document: Mapping[str, Any], folder: Path) -> list[Path]:
    """Cost over particles, cost over scenes, and gain over threads, side by side."""
    results = document["results"]
    curves = [curve for curve in CURVES if results[curve]]
    figure, axes = panels(len(curves), width=0.6 + 3.4 * len(curves))
    for axis, curve in zip(axes, curves, strict=True):
        for number, (name, rows) in enumerate(_lines(curve, results[curve]).items()):
            colour = COLOURS[number % len(COLOURS)]
            places = [row[curve] for row in rows]
            axis.plot(places, _heights(curve, rows), "o-", color=colour, markersize=4.5, label=name)
        _decorate(axis, curve, results)
    return [save(figure, folder / f"{document['problem']}.png")]


def _heights(curve: str, rows: Sequence[Mapping[str, Any]]) -> list[float]:
    times = [row["ms_per_1000"]["min"] for row in rows]
    return [times[0] / time for time in times] if curve == "threads" else times


def _decorate(axis: Axes, curve: str, results: Mapping[str, Any]) -> None:
    decorate(axis, CURVES[curve], "gain" if curve == "threads" else UNIT)
    mark(axis, sorted({row[curve] for row in results[curve]}))
    bounds = results["bounds"]
    if curve == "particles":
        highest = bounds["over_best"] * min(_heights(curve, results[curve]))
        axis.axhline(
            highest, linestyle=":", color="0.4", linewidth=1.0, label=f"{bounds['over_best']:g} times the least"
        )
    if curve == "threads" and any(row["threads"] == 2 for row in results[curve]):
        least = bounds["gain_of_two_threads"]
        axis.plot([2.0], [least], "_", color="0.2", markersize=18, label=f"{least:g} with two threads")
    axis.set_ylim(bottom=0.0)
    axis.legend(fontsize=7, frameon=False)


def _lines(curve: str, rows: Sequence[dict[str, Any]]) -> dict[str, list[dict[str, Any]]]:
    """The rows by implementation, and those over threads by the size of the body as well."""
    lines: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        size = f", {row['particles']} particles" if curve == "threads" else ""
        lines.setdefault(f"{row['backend']}{size}", []).append(row)
    return lines


def _table(curve: str, rows: Sequence[dict[str, Any]]) -> Table:
    table = table_of(f"cost of a forward step over {CURVES[curve]}", "backend", "particles", "scenes", "threads")
    ratio = "gain" if curve == "threads" else "over best"
    for header in ("ms per 1000", "median", "T [ms]", "T/1000", ratio, "peak MB", "above library"):
        table.add_column(escape(header), justify="right")
    for line in _lines(curve, rows).values():
        first, best = line[0]["ms_per_1000"]["min"], min(row["ms_per_1000"]["min"] for row in line)
        for row in line:
            time = row["ms_per_1000"]
            peak = row.get("memory") or {}
            table.add_row(
                row["backend"],
                str(row["particles"]),
                str(row["scenes"]),
                str(row["threads"]),
                f"{time['min']:.3g}",
                f"{time['median']:.3g}",
                f"{row['matmul_ms']['min']:.0f}",
                f"{row['cost']:.3g}",
                f"{first / time['min'] if curve == 'threads' else time['min'] / best:.2f}",
                *(f"{peak[key]:.0f}" if key in peak else "" for key in ("peak_mb", "above_mb")),
            )
    return table
