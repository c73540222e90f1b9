"""Laws trained on recordings as people have them: noisy positions without start velocities, and a false scene."""

import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.table import Table

from benchmarks.charts import COLOURS, chart, decorate, save, table_of
from benchmarks.checks import names, numbers, whole
from benchmarks.context import BenchmarkContext, Checkpointed
from benchmarks.laws_from_motions import Motions, Recipe, recorded_motions, trained
from pcnclaws.data.start_velocity import with_start_velocity
from pcnclaws.laws.materials import Material, material_named
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.training.trainer import quiet_lightning

# Which scene is false, and by which factor its last parameter is (the yield parameter of a material that flows).
FALSE, FACTOR = 4, 1.5


class Case(NamedTuple):
    """What is wrong with the data, and the loss; positions alone are seen where noise is named."""

    words: str
    loss: str = "relative"
    false_scene: bool = False
    positions_only: bool = False
    noisy: bool = False


CASES = {
    "true": Case("full states, all true"),
    "true_robust": Case("full states, all true, robust loss", "robust"),
    "false_relative": Case("one scene of them false", false_scene=True),
    "false_robust": Case("one scene of them false, robust loss", "robust", false_scene=True),
    "positions": Case("positions alone", positions_only=True),
    "noise": Case("noisy positions, no start velocities", positions_only=True, noisy=True),
}


def run(options: Mapping[str, Any], context: BenchmarkContext) -> dict[str, Any]:
    """Errors on the material's reference objects after each training.

    {"rows": [{"case", "words", "unseen", "scenes", "named", "seconds"}]}; MSE [m^2], None where a motion diverges;
    named are the training scenes that contradict the others
    """
    quiet_lightning()
    material = material_named(str(options["material"]))
    noise, cases = numbers({"noise": [options["noise"]]}, "noise", 0.0)[0], names(options, "cases", CASES)
    iterations = {name: whole(options, name) for name in ("iterations", "iterations_from_positions")}
    done = Checkpointed.load(context.folder, "imperfect_data", {"options": dict(options), "seed": context.seed})
    motions: Motions = {}
    rows = []
    for number, name in enumerate(cases):
        context.advance(number, len(cases), CASES[name].words)

        def made(case: Case = CASES[name]) -> dict[str, Any]:
            if not motions:
                motions.update(recorded_motions(material, whole(options, "scenes"), whole(options, "steps"), context))
            count = iterations["iterations_from_positions" if case.positions_only else "iterations"]
            return _row(case, material, motions, count, noise, context)

        rows.append({"case": name, "words": CASES[name].words, **done.row(name, made)})
    context.advance(len(cases), len(cases), "done")
    return {"rows": rows}


def tables(document: Mapping[str, Any]) -> list[Table]:
    """The errors, a line a case."""
    table = table_of("trained on imperfect data", "", "unseen, MSE [m²]", "named", "seconds")
    for row in document["results"]["rows"]:
        error = "diverged" if row["unseen"] is None else f"{row['unseen']:.1e}"
        table.add_row(row["words"], error, ", ".join(row["named"]), f"{row['seconds']:.0f}")
    return [table]


def draw(document: Mapping[str, Any], folder: Path) -> list[Path]:
    """The error of each case, a bar each."""
    rows = [row for row in document["results"]["rows"] if row["unseen"]]
    figure, axis = chart()
    axis.barh([row["words"] for row in rows], [row["unseen"] for row in rows], color=COLOURS[0])
    axis.invert_yaxis()
    axis.set_xscale("log")
    decorate(axis, "error on unseen parameters, MSE [m²]", "")
    return [save(figure, folder / f"{document['problem']}.png")]


def _row(
    case: Case,
    material: Material,
    motions: Motions,
    iterations: int,
    noise: float,
    context: BenchmarkContext,
) -> dict[str, Any]:
    training, checks = ([*motions[split]] for split in ("train", "validation"))
    if case.false_scene:
        chosen = min(FALSE, len(training) - 1)
        training[chosen] = _false(training[chosen], material)
    if case.noisy:
        random = np.random.default_rng(context.seed)
        training, checks = ([_seen(record, noise, random) for record in some] for some in (training, checks))
    recipe, began = Recipe(loss=case.loss, positions_only=case.positions_only), time.monotonic()
    seen = motions | {"train": training, "validation": checks}
    found = trained(material, seen, recipe, iterations, context)
    return {
        "seconds": time.monotonic() - began,
        "unseen": found.mean,
        "scenes": found.errors,
        "named": found.named,
    }


def _false(record: SceneRecord, material: Material) -> SceneRecord:
    """The record with a wrong value of the material's last parameter."""
    name = material.parameter_names[-1]
    return replace(record, parameters=dict(record.parameters) | {name: FACTOR * record.parameters[name]})


def _seen(record: SceneRecord, noise: float, random: np.random.Generator) -> SceneRecord:
    """What a tracker has of it: positions with noise [m], the first ones, too, and nothing else."""
    position = (record.position + noise * random.normal(size=record.position.shape)).astype(record.position.dtype)
    return with_start_velocity(
        replace(record, position=position, keyframes=None, initial_velocity=None, velocity=None, initial_affine=None)
    )
