"""The table and the picture of the error on unseen parameters against training time."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.markup import escape
from rich.table import Table

from benchmarks.charts import COLOURS, chart, decorate, save, table_of


def tables(document: Mapping[str, Any]) -> list[Table]:
    """Error and time of each training."""
    results = document["results"]
    table = table_of(f"unseen {results['material']}: error against training time", "backend", "iterations", "seconds")
    table.add_column(escape("MSE [m^2]"), justify="right")
    table.add_row("", "0", "0", _error(results["untrained_mse"]))
    for row in results["rows"]:
        table.add_row(row["backend"], str(row["iterations"]), f"{row['seconds']:.1f}", _error(row["mse"]))
    return [table]


def draw(document: Mapping[str, Any], folder: Path) -> list[Path]:
    """The error over the training time, one curve an implementation, from the untrained law on."""
    results = document["results"]
    figure, axis = chart()
    for number, backend in enumerate(dict.fromkeys(row["backend"] for row in results["rows"])):
        rows = [{"iterations": 0, "seconds": 0.0, "mse": results["untrained_mse"]}]
        rows += [row for row in results["rows"] if row["backend"] == backend]
        rows = [row for row in rows if row["mse"]]
        seconds, errors = [row["seconds"] for row in rows], [row["mse"] for row in rows]
        axis.plot(seconds, errors, "o-", color=COLOURS[number], markersize=4.5, label=f"backend {backend}")
        for row in rows:
            axis.annotate(
                str(row["iterations"]), (row["seconds"], row["mse"]), (4, 4), textcoords="offset points", fontsize=7
            )
    if results["paper_mse"]:
        axis.axhline(results["paper_mse"], linestyle=":", color="0.5", linewidth=1.0, label="paper")
    decorate(axis, "training time [s], beside each point its iterations", "error on unseen parameters, MSE [m²]")
    axis.set_yscale("log")
    axis.legend(fontsize=8, frameon=False)
    axis.set_title(f"{results['material']}, {document['provenance']['threads']} thread(s)", fontsize=9)
    return [save(figure, folder / f"{document['problem']}.png")]


def _error(value: float | None) -> str:
    return "diverged" if value is None else f"{value:.1e}"
