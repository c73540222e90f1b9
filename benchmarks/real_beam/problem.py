"""The measured beam as a benchmark problem: simulations, fit, prediction, page; resumable."""

import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from benchmarks.checks import numbers, wholes
from benchmarks.context import BenchmarkContext, Checkpointed
from benchmarks.pages.real_beam import write_real_beam
from benchmarks.real_beam.conclusions import BATCHES, conclusions
from benchmarks.real_beam.report import tables
from benchmarks.real_beam.runs import CELLS, POISSON, RATIO_CELLS, YOUNG, plan, timoshenko
from benchmarks.real_beam.scene import Beam
from pcnclaws.evaluation.report import write_metrics

__all__ = ["draw", "run", "tables"]

NAME = "real_beam"
# The authors' E [Pa] and what COMSOL says of the upper edge of the tip with it [m].
AUTHORS_YOUNG, COMSOL_SAG = 263824.0, 6.77e-3


def run(options: Mapping[str, Any], context: BenchmarkContext) -> dict[str, Any]:
    """Fits, comparisons, studies, and the prediction, which goes into the folder of results."""
    cells = wholes(options, "cells", least=2)
    ratios = numbers(options, "poissons_ratios", above=0.0, below=0.495)
    stored = Checkpointed.load(context.folder, NAME, {"device": str(context.device)})
    studies = plan(cells, ratios)
    total, done = len(studies) + BATCHES, 0

    def row(name: str, make: Callable[[], Any]) -> Any:
        nonlocal done
        context.advance(done, total, name)
        done += 1
        return stored.row(name, make)

    found = conclusions(row, context.folder, context.seed)
    rows = {name: row(name, make) for name, make in studies.items()}
    context.advance(total, total, "page")
    return found | {
        "convergence": {name: one for name, one in rows.items() if " cells, " in name},
        "poissons_ratios": {name: one for name, one in rows.items() if name.startswith("nu ")},
        "cells_of_ratios": RATIO_CELLS,
        "theory": timoshenko(Beam(CELLS, AUTHORS_YOUNG, 0.499))
        | {"comsol_sag": COMSOL_SAG, "youngs_modulus": AUTHORS_YOUNG},
        "simulated_with": {"youngs_modulus": YOUNG, "poissons_ratio": POISSON, "cells": CELLS},
        "theory_of_simulated": timoshenko(Beam(CELLS, YOUNG, POISSON)),
    }


def draw(document: Mapping[str, Any], folder: Path) -> list[Path]:
    """The page with its pictures and files, where problem.page and problem.results say."""
    options, results = document["options"], document["results"]
    page, place = Path(options["page"]), Path(options["results"])
    place.mkdir(parents=True, exist_ok=True)
    written = [write_metrics(place / f"{NAME}.json", document)]
    for name in results["heavy"]["files"]:
        if folder.resolve() != place.resolve() and (folder / name).is_file():
            written.append(Path(shutil.copy(folder / name, place / name)))
    return written + write_real_beam(document, page, place)
