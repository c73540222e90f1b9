"""Verification as a benchmark problem: runs the table of cases, keeps what is done, writes the page."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.table import Table

from benchmarks.charts import table_of
from benchmarks.checks import names
from benchmarks.context import BenchmarkContext, Checkpointed
from benchmarks.pages.verification import write_verification
from benchmarks.verification.case import OUTSIDE
from benchmarks.verification.cases import CASES
from pcnclaws.evaluation.report import write_metrics

NAME, ALL = "verification", "all"


def run(options: Mapping[str, Any], context: BenchmarkContext) -> dict[str, Any]:
    """The rows of the chosen cases.

    {"rows": [{"name", "group", "sentence", "source", "ours", "theirs", "unit", "difference", "tolerance", "verdict",
    "why", "command", "curve", "table"}]}
    """
    chosen = [*CASES] if [*options["cases"]] == [ALL] else names(options, "cases", CASES)
    stored = Checkpointed.load(context.folder, NAME, {"device": str(context.device)})
    rows = []
    for number, name in enumerate(chosen):
        context.advance(number, len(chosen), name)
        rows.append(CASES[name].row(stored.row(name, CASES[name].measured)))
    context.advance(len(chosen), len(chosen), "done")
    return {"rows": rows}


def draw(document: Mapping[str, Any], folder: Path) -> list[Path]:
    """The page and its pictures in `folder`; with the whole table also where problem.page and problem.document say."""
    written = write_verification(document, folder / f"{NAME}.md", folder / NAME)
    if not set(CASES) <= {row["name"] for row in document["results"]["rows"]}:
        return written
    page, result = (Path(document["options"][name]) for name in ("page", "document"))
    written.append(write_metrics(result, document))
    return written + write_verification(document, page, page.parent / "images" / NAME)


def tables(document: Mapping[str, Any]) -> list[Table]:
    """The rows without their sentences."""
    table = table_of("verification", "case", "ours", "theirs", "difference", "tolerance")
    table.add_column("verdict")
    for row in document["results"]["rows"]:
        measured = "ours" in row
        cells = [f"{row[name]:.6g} {row['unit']}".strip() for name in ("ours", "theirs")] if measured else ["", ""]
        bound = [f"{row[name]:.1e}" for name in ("difference", "tolerance")] if measured else ["", ""]
        style = "bold red" if row["verdict"] == OUTSIDE else None
        table.add_row(row["name"], *cells, *bound, row["verdict"], style=style)
    return [table]
