"""Pictures and tables of the stress problem, from the result document alone."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle
from rich.table import Table

from benchmarks.charts import DPI, decorate, save, table_of
from benchmarks.stress.fates import FAULT, GAINS, HOLDS, REFUSED, STOPPED
from benchmarks.stress.long_runs import verdicts

SHADES = {HOLDS: "#2a788e", REFUSED: "#cccccc", STOPPED: "#b8de29", GAINS: "#f8a255", FAULT: "#b63679"}
WORDS = {
    HOLDS: "holds: finite, energy bounded",
    REFUSED: "refused before the run, in one line",
    STOPPED: "stopped, with scene, step, particle and reason",
    GAINS: "gains energy",
    FAULT: "at fault",
}
Row = Mapping[str, Any]


def draw(document: Mapping[str, Any], folder: Path) -> list[Path]:
    """The survival map, and the landscapes of derivatives that disagree."""
    results = document["results"]
    pictures = [_survival(results["fates"], folder / "stress_survival.png")] if results["fates"] else []
    if results["landscapes"]:
        pictures.append(_landscapes(results["landscapes"], folder / "stress_landscapes.png"))
    return pictures


def tables(document: Mapping[str, Any]) -> list[Table]:
    """How many scenes met which fate; the long runs; the worst agreement of derivatives."""
    results = document["results"]
    return [
        _counts(results["fates"]),
        *([_long(results["long"])] if results["long"] else []),
        *([_gradients(results["gradients"])] if results["gradients"] else []),
    ]


def _counts(rows: Sequence[Row]) -> Table:
    table = table_of("what became of the scenes", "material, law", *WORDS)
    for key in dict.fromkeys((row["material"], row["law"]) for row in rows):
        same = [row["fate"] for row in rows if (row["material"], row["law"]) == key]
        table.add_row(", ".join(key), *(str(same.count(fate)) for fate in WORDS))
    return table


def _long(rows: Sequence[Row]) -> Table:
    table = table_of("long runs", "material, law", "growth of energy", "drift / dx", "afloat / dx", "creep", "holds")
    for row in rows:
        figures = (row[name] for name in ("growth", "drift", "floating_drift", "creep"))
        holds = "yes" if all(verdicts(row).values()) else "no"
        shown = ("-" if figure is None else f"{figure:.1e}" for figure in figures)
        table.add_row(f"{row['material']}, {row['law']}", *shown, holds)
    return table


def _gradients(rows: Sequence[Row]) -> Table:
    table = table_of(
        "derivatives: largest relative deviation from reverse mode", "steps, kind", "forward", "difference"
    )
    for key in dict.fromkeys((row["steps"], row["backend"]) for row in rows):
        same = [row for row in rows if (row["steps"], row["backend"]) == key]
        worst = (max(row.get(f"{mode}_error", 0.0) for row in same) for mode in ("forward", "difference"))
        table.add_row(f"{key[0]}, {key[1]}", *(f"{one:.1e}" for one in worst))
    return table


def _survival(rows: Sequence[Row], path: Path) -> Path:
    """A column a material and law, a line an axis, a field a value."""
    columns = list(dict.fromkeys((row["material"], row["law"]) for row in rows))
    lines = list(dict.fromkeys(row["axis"] for row in rows))
    figure = Figure(figsize=(2.3 * len(columns) + 1.6, 0.42 * len(lines) + 1.2), dpi=DPI, layout="constrained")
    axes = figure.subplots(1, len(columns), squeeze=False, sharey=True)[0]
    for axis, (material, law) in zip(axes, columns, strict=True):
        for height, line in enumerate(lines):
            same = [row for row in rows if (row["material"], row["law"], row["axis"]) == (material, law, line)]
            _fields(axis, height, [row["fate"] for row in same])
        axis.set_title(f"{material}, {law}", fontsize=8)
        axis.set_xlim(0, 1)
        axis.set_ylim(len(lines) - 0.5, -0.5)
        axis.set_xticks([])
        axis.set_yticks(range(len(lines)), lines, fontsize=8)
        axis.spines[:].set_visible(False)
    met = [fate for fate in WORDS if any(row["fate"] == fate for row in rows)]
    patches = [Patch(color=SHADES[fate], label=WORDS[fate]) for fate in met]
    figure.legend(handles=patches, loc="outside lower center", ncols=len(patches), fontsize=7, frameon=False)
    return save(figure, path)


def _fields(axis: Axes, height: int, fates: Sequence[str]) -> None:
    for place, fate in enumerate(fates):
        width = 1.0 / len(fates)
        field = Rectangle((place * width, height - 0.4), 0.96 * width, 0.8, color=SHADES[fate], linewidth=0)
        axis.add_patch(field)


def _landscapes(rows: Sequence[Row], path: Path) -> Path:
    """The number over the direction, with the slope that reverse mode says."""
    distinct = list({(row["material"], row["unknown"], row["steps"]): row for row in rows}.values())
    figure = Figure(figsize=(3.6 * len(distinct), 2.8), dpi=DPI, layout="constrained")
    for axis, row in zip(figure.subplots(1, len(distinct), squeeze=False)[0], distinct, strict=True):
        middle = row["value"][len(row["value"]) // 2]
        axis.plot(row["t"], [value - middle for value in row["value"]], ".-", markersize=3, linewidth=0.8)
        axis.plot(row["t"], [row["slope"] * t for t in row["t"]], "k--", linewidth=0.8, label="reverse mode")
        axis.set_title(f"{row['material']}, {row['unknown']}, {row['steps']} steps", fontsize=7)
        decorate(axis, "share of the unknown", "change of the number [m]")
        axis.legend(fontsize=7)
    return save(figure, path)
