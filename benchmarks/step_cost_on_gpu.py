"""The table and the picture of the cost of a step on a GPU: few particles take as long there as many."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.table import Table

from benchmarks.charts import COLOURS, axis_floor, chart, decorate, save, table_of

BAR = 0.8
# What a step may cost [us], by kind and number of particles: the aims for a current GPU.
AIMS = {("A", 1000): 60.0, ("D", 12_000): 500.0, ("A", 1_000_000): 1e6 / 300.0}


def microseconds(row: Mapping[str, Any], which: str = "min") -> float:
    """Time of a step [us]."""
    return 1e3 * row["ms_per_1000"][which] * row["particles"] / 1000.0


def table(rows: Sequence[Mapping[str, Any]]) -> Table:
    """Time of a step of every row, and the aims."""
    found = table_of(
        "time of a step on a GPU",
        "",
        *("backend", "scenes", "particles", "us", "median", "10^6 particle-steps/s", "aim [us]"),
    )
    for row in rows:
        aim = AIMS.get((row["kind"], row["particles"]))
        found.add_row(
            f"{row['kind']} {row['words']}",
            row["backend"],
            str(row["scenes"]),
            str(row["particles"]),
            f"{microseconds(row):.3g}",
            f"{microseconds(row, 'median'):.3g}",
            f"{row['particles'] / microseconds(row):.3g}",
            f"{aim:.4g}" if aim else "",
        )
    return found


def draw(document: Mapping[str, Any], folder: Path) -> list[Path]:
    """Bars of the time of each kind of step, by implementation, and the aims."""
    rows = document["results"]["rows"]
    groups = list(dict.fromkeys((row["kind"], row["scenes"], row["particles"]) for row in rows))
    backends = list(dict.fromkeys(row["backend"] for row in rows))
    figure, axis = chart(width=9.0, height=4.0)
    width = BAR / len(backends)
    for number, backend in enumerate(backends):
        own = [row for row in rows if row["backend"] == backend]
        places = [groups.index((row["kind"], row["scenes"], row["particles"])) for row in own]
        left = [place + (number + 0.5) * width - BAR / 2 for place in places]
        axis.bar(left, [microseconds(row) for row in own], width, color=COLOURS[number], label=backend)
    for place, (kind, _, particles) in enumerate(groups):
        if (kind, particles) in AIMS:
            height = AIMS[kind, particles]
            label = None if axis.get_legend_handles_labels()[1].count("aim") else "aim"
            axis.plot((place - BAR / 2, place + BAR / 2), (height, height), color="black", linewidth=1.2, label=label)
    axis.set_yscale("log")
    axis.set_ylim(bottom=axis_floor(microseconds(row) for row in rows))
    names = [f"{kind}\n{scenes} x {count // scenes:,}".replace(",", " ") for kind, scenes, count in groups]
    axis.set_xticks(range(len(groups)), names, fontsize=8)
    decorate(axis, "scenes x particles", "time of a step [us]")
    axis.grid(False, axis="x")
    axis.legend(fontsize=7, frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    kinds = {row["kind"]: row["words"] for row in rows}
    words = "; ".join(f"{kind}: {meaning}" for kind, meaning in kinds.items())
    figure.supxlabel(f"{words}\n{document['provenance']['device']}", fontsize=7, color="0.4")
    return [save(figure, folder / f"{document['problem']}.png")]
