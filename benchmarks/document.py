"""The result document of a benchmark problem: made, written whole, read back, drawn."""

import json
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from benchmarks.context import BenchmarkContext, commits_of, partial_file
from benchmarks.problems import PROBLEMS
from pcnclaws.errors import UserError, unknown_name
from pcnclaws.evaluation.report import write_metrics
from pcnclaws.provenance import provenance


def measure(name: str, options: Mapping[str, Any], context: BenchmarkContext) -> Path:
    """Runs a problem and writes <folder>/<name>.json; its partial results are removed then.

    {"problem", "options", "provenance", "yardstick": {"matmul_2048_ms", ...}, "seconds", "results"}

    options  those of problem.*, without the name
    raises   UserError for an option that is not accepted
    """
    if name not in PROBLEMS:
        raise unknown_name("problem", name, PROBLEMS)
    began = time.monotonic()
    origin = provenance(context.seed, context.device)  # of the code that runs
    results = PROBLEMS[name].run(options, context)
    context.yardstick.measure()
    document = {
        "problem": name,
        "options": dict(options),
        "provenance": origin | {"resumed_commits": commits_of(context.folder, name)},
        "yardstick": context.yardstick.summary(),
        "seconds": time.monotonic() - began,
        "results": results,
    }
    path = write_metrics(context.folder / f"{name}.json", document)
    partial_file(context.folder, name).unlink(missing_ok=True)
    return path


def read_document(path: Path, name: str) -> dict[str, Any]:
    """The result document of a problem; UserError when the file holds no such thing."""
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise UserError(f"redraw={path} cannot be read ({type(error).__name__}); accepted: a result file") from error
    if not isinstance(document, dict) or document.get("problem") != name or "results" not in document:
        raise UserError(f"redraw={path} holds no results of problem={name}; accepted: a result file of this problem")
    return document
