"""The table and the picture of what the switches gain."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.markup import escape
from rich.table import Table

from benchmarks.charts import COLOURS, chart, decorate, save, table_of

BAR = 0.8


def tables(document: Mapping[str, Any]) -> list[Table]:
    """Time of a step with each switch on and off, the largest difference, and peak memory."""
    table = table_of("gain of each switch of simulation.skip (all others on)", "switch")
    for header in ("scene", "backend"):
        table.add_column(header)
    for header in ("steps", "on [ms]", "off [ms]", "gain", "difference", "relative", "MB on", "MB off"):
        table.add_column(escape(header), justify="right")
    for row in document["results"]["rows"]:
        memory = row["memory"] or {}
        table.add_row(
            row["switch"],
            row["scene"],
            row["backend"],
            str(row["steps"]),
            f"{row['on_ms']['min']:.3g}",
            f"{row['off_ms']['min']:.3g}",
            f"{row['gain']:.2f}",
            f"{row['difference']:.1g}",
            f"{row['relative_difference']:.1g}",
            *(f"{memory[key]['above_mb']:.0f}" if memory.get(key) else "" for key in ("on", "off")),
        )
    return [table]


def draw(document: Mapping[str, Any], folder: Path) -> list[Path]:
    """A bar for the gain of each switch, with the difference that it makes beside it."""
    rows = document["results"]["rows"]
    switches, backends = (
        list(dict.fromkeys(row["switch"] for row in rows)),
        list(dict.fromkeys(r["backend"] for r in rows)),
    )
    figure, axis = chart(height=1.2 + 0.45 * len(switches))
    width = BAR / len(backends)
    for row in rows:
        number = backends.index(row["backend"])
        place = switches.index(row["switch"]) - BAR / 2 + (number + 0.5) * width
        axis.barh(place, row["gain"], width, color=COLOURS[number])
        said = "exact" if row["difference"] == 0.0 else f"within {row['relative_difference']:.0e}"
        axis.annotate(
            f"{row['gain']:.2f}, {said}",
            (row["gain"], place),
            (3, 0),
            textcoords="offset points",
            fontsize=7,
            va="center",
        )
    for number, backend in enumerate(backends):
        axis.barh([], [], color=COLOURS[number], label=f"backend {backend}")
    axis.axvline(1.0, color="0.4", linewidth=1.0)
    axis.set_yticks(range(len(switches)), switches)
    axis.invert_yaxis()
    axis.margins(x=0.25)
    decorate(axis, "run time with the switch off / on", "")
    axis.grid(False, axis="y")
    axis.legend(fontsize=7, frameon=False)
    return [save(figure, folder / f"{document['problem']}.png")]
