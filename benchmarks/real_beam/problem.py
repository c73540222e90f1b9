"""The measured beam as a benchmark problem: simulations, fit, prediction, page; resumable."""

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.checks import numbers, wholes
from benchmarks.context import BenchmarkContext, Checkpointed
from benchmarks.pages.real_beam import write_real_beam
from benchmarks.real_beam.fit import CREEP, NAMES, REGISTRATION, fit, start_of
from benchmarks.real_beam.measured import GRAVITY_FILE, LOADED_FILE, clamp_moved, read
from benchmarks.real_beam.prediction import (
    HEAVY,
    LET_GO,
    LOADED,
    Known,
    comparison,
    coverage,
    figures,
    with_band,
    write_prediction,
)
from benchmarks.real_beam.report import tables
from benchmarks.real_beam.runs import CELLS, POISSON, RATIO_CELLS, YOUNG, plan, timoshenko
from benchmarks.real_beam.scene import Beam
from benchmarks.real_beam.surrogate import SLOWEST, Family
from pcnclaws.evaluation.report import write_metrics

__all__ = ["draw", "run", "tables"]

NAME, PREDICTED = "real_beam", "predicted_101g.csv"
# What a fit begins with, and what it always estimates.
FIRST_CREEP, LAW = 0.03, ("youngs_modulus", "viscosity")
# The authors' E [Pa] and what COMSOL says of the upper edge of the tip with it [m].
AUTHORS_YOUNG, COMSOL_SAG = 263824.0, 6.77e-3


def run(options: Mapping[str, Any], context: BenchmarkContext) -> dict[str, Any]:
    """Fits, comparisons, studies, and the prediction, which goes into the folder of results."""
    cells = wholes(options, "cells", least=2)
    ratios = numbers(options, "poissons_ratios", above=0.0, below=0.495)
    rows = plan(cells, ratios)
    stored = Checkpointed.load(context.folder, NAME, {"device": str(context.device)})
    for number, (name, make) in enumerate(rows.items()):
        context.advance(number, len(rows), name)
        stored.row(name, make)
    context.advance(len(rows), len(rows), "fit and prediction")
    found = {name: stored.rows[name] for name in rows}
    return _conclusions(found, context) | {
        "convergence": {name: row for name, row in found.items() if " cells, " in name},
        "poissons_ratios": {name: row for name, row in found.items() if name.startswith("nu ")},
        "cells_of_ratios": RATIO_CELLS,
        "theory": timoshenko(Beam(CELLS, AUTHORS_YOUNG, 0.499))
        | {"comsol_sag": COMSOL_SAG, "youngs_modulus": AUTHORS_YOUNG},
        "simulated_with": {"youngs_modulus": YOUNG, "poissons_ratio": POISSON, "cells": CELLS},
        "theory_of_simulated": timoshenko(Beam(CELLS, YOUNG, POISSON)),
    }


def _conclusions(rows: Mapping[str, Any], context: BenchmarkContext) -> dict[str, Any]:
    bare_file, loaded_file = read(GRAVITY_FILE), read(LOADED_FILE)
    bare_family, loaded_family, heavy_family = (
        Family(weight, rows[f"{1e3 * weight:g} g"]) for weight in (0.0, LOADED, HEAVY)
    )
    found: dict[str, Any] = {}
    for creep, end in ((), ""), (CREEP, "_creeping"):
        start = start_of(bare_file, 0.0)
        start[NAMES.index("creep")] = FIRST_CREEP if creep else 0.0
        first = fit(bare_file, bare_family, start, (*LAW, "release", *REGISTRATION, *creep))
        # the prediction knows of the loaded recording where its markers start, and when they start to move
        carried = first.values.copy()
        carried[2], carried[3:5] = loaded_file.onset, carried[3:5] + clamp_moved(bare_file, loaded_file)[[2, 0]]
        aligned = fit(loaded_file, loaded_family, carried, ("release",))
        second = fit(loaded_file, loaded_family, carried, (*LAW, "release", *creep))
        motions = {
            "bare": (bare_file, bare_family, first.values, 0.0),
            "predicted": (loaded_file, loaded_family, carried, LOADED),
            "aligned": (loaded_file, loaded_family, aligned.values, LOADED),
            "loaded": (loaded_file, loaded_family, second.values, LOADED),
        }
        found |= {f"{name}{end}": comparison(*given) for name, given in motions.items()}
        found |= {f"fit{end}": first.plain(), f"loaded_fit{end}": second.plain()}
        bare, loaded = Known(bare_file, first, bare_family, 0.0), Known(loaded_file, second, loaded_family, LOADED)
    heavy = with_band(bare, loaded, heavy_family, HEAVY, context.seed)
    written = write_prediction(heavy, context.folder / PREDICTED)
    height = {name: heavy[name][:, 0, 0] - heavy["middle"][0, 0, 0] for name in ("middle", "low", "high")}
    return found | {
        "heavy": figures(height["middle"], heavy["time"], LET_GO, SLOWEST)
        | {
            "files": [path.name for path in written],
            "curve": {
                "time": heavy["time"].tolist(),
                **{name: np.round(row, 7).tolist() for name, row in height.items()},
            },
        },
        "coverage_of_loaded": coverage(bare, loaded, context.seed),
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
