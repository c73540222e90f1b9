"""Materials of other forms than the neural laws', learned from the positions of twelve motions alone."""

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.table import Table

from benchmarks.charts import COLOURS, chart, decorate, save, table_of
from benchmarks.checks import names, whole
from benchmarks.context import BenchmarkContext, Checkpointed
from benchmarks.foreign_materials import FOREIGN
from benchmarks.laws_from_motions import Motions, Recipe, positions_alone, recorded_motions, trained
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.laws.registry import register
from pcnclaws.training.trainer import quiet_lightning

# For elastic materials and for those that flow.
MODELS = {False: ("pcnclaws", "pcnclaws_energy"), True: ("pcnclaws", "pcnclaws_free_flow", "pcnclaws_convex")}
# Those that Levenberg-Marquardt finds, from positions alone; Adam the others.
LEAST_SQUARES = ("pcnclaws_energy", "pcnclaws_convex")


def run(options: Mapping[str, Any], context: BenchmarkContext) -> dict[str, Any]:
    """Errors on the test objects of each material, for each model that is asked for.

    {"rows": [{"material", "model", "positions_only", "unseen", "scenes", "seconds"}]}; MSE [m^2], None where a motion
    diverges
    """
    quiet_lightning()
    materials = [FOREIGN[name] for name in names(options, "materials", FOREIGN)]
    models = names(options, "models", {name: None for some in MODELS.values() for name in some})
    alone, iterations = bool(options["positions_only"]), whole(options, "iterations")
    steps = whole(options, "iterations_of_least_squares")
    orders = [
        (material, model) for material in materials for model in MODELS[material.plastic is not None] if model in models
    ]
    key = {name: value for name, value in options.items() if name not in ("materials", "models")}
    done = Checkpointed.load(context.folder, "foreign_laws", {"options": key, "seed": context.seed})
    known: dict[str, Motions] = {}
    rows = []
    for number, (material, model) in enumerate(orders):
        context.advance(number, len(orders), f"{material.name} by {model}")

        def made(material: Any = material, model: str = model) -> dict[str, Any]:
            if material.name not in known:
                known.clear()
                if material.name not in MATERIALS:
                    register(material)
                motions = recorded_motions(material, whole(options, "scenes"), whole(options, "steps"), context)
                seen = {name: positions_alone(motions[name]) for name in ("train", "validation")} if alone else {}
                known[material.name] = motions | seen
            began = time.monotonic()
            least = model in LEAST_SQUARES
            method = "levenberg_marquardt" if least else "adam"
            recipe = Recipe(model, positions_only=alone or least, method=method)
            found = trained(material, known[material.name], recipe, steps if least else iterations, context)
            return {"unseen": found.mean, "scenes": found.errors, "seconds": time.monotonic() - began}

        row = done.row(f"{material.name}, {model}", made)
        rows.append({"material": material.name, "model": model, "positions_only": alone, **row})
    context.advance(len(orders), len(orders), "done")
    return {"rows": rows}


def tables(document: Mapping[str, Any]) -> list[Table]:
    """The errors, a line a training."""
    table = table_of("materials of other forms", "", "model", "unseen, MSE [m²]", "seconds")
    for row in document["results"]["rows"]:
        error = "diverged" if row["unseen"] is None else f"{row['unseen']:.1e}"
        table.add_row(row["material"], row["model"], error, f"{row['seconds']:.0f}")
    return [table]


def draw(document: Mapping[str, Any], folder: Path) -> list[Path]:
    """The error of each material and model, a bar each."""
    rows = [row for row in document["results"]["rows"] if row["unseen"]]
    models = list(dict.fromkeys(row["model"] for row in rows))
    figure, axis = chart(height=1.2 + 0.3 * len(rows))
    for model in models:
        some = [place for place, row in enumerate(rows) if row["model"] == model]
        axis.barh(some, [rows[k]["unseen"] for k in some], color=COLOURS[models.index(model)], label=model)
    axis.set_yticks(range(len(rows)), [row["material"] for row in rows], fontsize=7)
    axis.invert_yaxis()
    axis.set_xscale("log")
    axis.legend(fontsize=7, frameon=False)
    decorate(axis, "error on unseen parameters, MSE [m²]", "")
    return [save(figure, folder / f"{document['problem']}.png")]
