"""What problem=data_parallel shows, from its result document alone."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.table import Table

from benchmarks.charts import COLOURS, chart, decorate, save, table_of

Document = Mapping[str, Any]


def tables(document: Document) -> list[Table]:
    """The trainings, and the memory of a gradient."""
    results = document["results"]
    heads = ("segments a batch", "ms an iteration", "difference of weights", "load before")
    trainings = table_of("Training in several processes", "processes", *heads)
    for row in results["rows"]:
        difference = "-" if row["difference"] is None else f"{row['difference']:.1e}"
        numbers = (f"{row['segments']}", f"{row['ms_per_iteration']:.0f}", difference, f"{row['load']:.1f}")
        trainings.add_row(f"{row['processes']}", *numbers)
    memory = table_of("Gradient of a segment of 20 steps", "particles", "kB a particle")
    for row in results["memory"]:
        above = row["above_mb"]
        memory.add_row(f"{row['particles']}", "-" if above is None else f"{1e3 * above / row['particles']:.1f}")
    return [trainings, memory]


def draw(document: Document, folder: Path) -> list[Path]:
    """Bars: the time of an iteration in each training."""
    rows = document["results"]["rows"]
    names = [f"{row['processes']} x {row['segments'] // row['processes']}" for row in rows]
    figure, axes = chart()
    axes.bar(names, [row["ms_per_iteration"] for row in rows], color=COLOURS[0], width=0.6)
    decorate(axes, "processes x segments of each", "ms an iteration")
    return [save(figure, folder / "data_parallel.png")]
