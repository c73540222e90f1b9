"""Laws trained on recordings as people have them: noisy positions without start velocities, and a false scene."""

import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from rich.console import Console
from rich.table import Table

from benchmarks.charts import COLOURS, chart, decorate, save, table_of
from benchmarks.checks import names, numbers, whole
from benchmarks.context import BenchmarkContext, Checkpointed
from pcnclaws.commands.models import build_model
from pcnclaws.data.datamodule import TrajectoryDataModule
from pcnclaws.data.sampling import DataSetPlan, planned_scenes
from pcnclaws.data.segments import SegmentPlan
from pcnclaws.data.start_velocity import with_start_velocity
from pcnclaws.errors import SimulationDiverged
from pcnclaws.evaluation.tasks import evaluate_records
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.materials import Material, material_named
from pcnclaws.simulation.execution import Execution
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.training.loop import Loop
from pcnclaws.training.module import OptimiserSettings
from pcnclaws.training.multi_scene import MultiSceneModule
from pcnclaws.training.sources import show_deformations
from pcnclaws.training.trainer import fit, quiet_lightning

EVERY, KEYFRAME_EVERY = 5, 20
# As in conf/training/short.yaml and initial.yaml.
SHORT = {"segments": 8, "first": 5, "last": 5}
INITIAL = {"segments": 2, "start": "initial", "first": 150, "last": 400}
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
    motions: dict[str, list[SceneRecord]] = {}
    rows = []
    for number, name in enumerate(cases):
        context.advance(number, len(cases), CASES[name].words)

        def made(case: Case = CASES[name]) -> dict[str, Any]:
            if not motions:
                motions.update(_motions(material, whole(options, "scenes"), whole(options, "steps"), context))
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


def _motions(material: Material, scenes: int, steps: int, context: BenchmarkContext) -> dict[str, list[SceneRecord]]:
    plan = DataSetPlan(
        material,
        steps=steps,
        keyframe_every=KEYFRAME_EVERY,
        train_scenes=scenes,
        validation_scenes=2,
        seed=context.seed,
    )
    frames, execution = FramePlan(steps, EVERY, KEYFRAME_EVERY), Execution(device=context.device)
    starts = planned_scenes(plan)
    return {split: simulate_records(some, analytic_laws(material), frames, execution) for split, some in starts.items()}


def _row(
    case: Case,
    material: Material,
    motions: Mapping[str, Sequence[SceneRecord]],
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
    torch.manual_seed(context.seed)
    model, began = build_model(material, {"name": "pcnclaws"}), time.monotonic()
    laws = model.laws
    assert laws is not None  # noqa: S101
    show_deformations(laws.elasticity, training)
    plan = SegmentPlan(iterations, seed=context.seed, **(INITIAL if case.positions_only else SHORT))  # pyright: ignore[reportArgumentType]
    segments = TrajectoryDataModule(training, checks, plan, check_every=max(iterations // 4, 1))
    rate = 3e-3 if case.positions_only else 5e-3
    settings = OptimiserSettings(rate, gradient_clip=10.0, loss=case.loss)
    module = MultiSceneModule(laws, segments.dataset.settings, settings, iterations)
    loop = Loop(logger="csv", average=None if case.positions_only else 8.0, pictures=False)
    try:
        with tempfile.TemporaryDirectory() as folder:
            fit(module, segments, Path(folder), context.device, loop, console=Console(quiet=True))
        results = evaluate_records(motions["test"], model)
        errors = [one.mse for one in results]
    except SimulationDiverged:
        errors = []
    return {
        "seconds": time.monotonic() - began,
        "unseen": sum(errors) / len(errors) if errors else None,
        "scenes": errors,
        "named": sorted(module.contradicting()),
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
