"""Error of a trained law on unseen parameters against the time that its training took."""

import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import torch
from rich.console import Console

from benchmarks.cases import NEURAL_MODEL
from benchmarks.checks import names, whole, wholes
from benchmarks.context import BenchmarkContext
from benchmarks.training_time_report import draw, tables
from pcnclaws.compiled.backend import BACKENDS, using_backend
from pcnclaws.data.datamodule import TrajectoryDataModule
from pcnclaws.data.sampling import DataSetPlan, planned_scenes
from pcnclaws.data.segments import SegmentPlan
from pcnclaws.errors import SimulationDiverged, UserError
from pcnclaws.evaluation.builtin import paper_errors
from pcnclaws.evaluation.tasks import evaluate_records
from pcnclaws.geometry.shapes import particles
from pcnclaws.laws.analytic import Laws, analytic_laws
from pcnclaws.laws.materials import Material, material_named
from pcnclaws.laws.neural import build_neural_laws
from pcnclaws.simulation.execution import Execution
from pcnclaws.simulation.law_simulator import LawSimulator
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.training.module import OptimiserSettings
from pcnclaws.training.multi_scene import MultiSceneModule
from pcnclaws.training.trainer import fit, quiet_lightning

__all__ = ["draw", "run", "tables"]

# As in conf/training/keyframes.yaml.
SEGMENTS, SEGMENT_LENGTH = 4, 20
OPTIMISER = OptimiserSettings(gradient_clip=10.0)


def run(options: Mapping[str, Any], context: BenchmarkContext) -> dict[str, Any]:
    """Errors before training and after trainings of several lengths, each with its own learning-rate schedule.

    {"untrained_mse", "paper_mse", "data_seconds", "rows": [{"backend", "iterations", "seconds", "mse", "scenes"}]}
    """
    plan, lengths = _data_plan(options, context.seed), wholes(options, "iterations")
    backends = names(options, "backends", BACKENDS)
    total = 1 + len(lengths) * len(backends)
    quiet_lightning()
    context.advance(0, total, "making data")
    began = time.monotonic()
    data = _data(plan, context)
    results: dict[str, Any] = {"material": plan.material.name, "data_seconds": time.monotonic() - began}
    results |= {"untrained_mse": _errors(_untrained(plan.material, context), data["test"], context)["mse"], "rows": []}
    published = paper_errors(plan.material)
    results["paper_mse"] = sum(published.values()) / len(published) if published else None
    for backend in backends:
        for iterations in lengths:
            context.advance(1 + len(results["rows"]), total, f"{iterations} iterations, {backend}")
            context.yardstick.measure()
            with using_backend(backend):
                row = _trained(plan.material, data, iterations, context)
            results["rows"].append({"backend": backend, "iterations": iterations, **row})
    context.advance(total, total, "done")
    return results


def _data_plan(options: Mapping[str, Any], seed: int) -> DataSetPlan:
    edge, steps = whole(options, "particles_per_edge", least=2), whole(options, "steps")
    if steps % SEGMENT_LENGTH:
        raise UserError(f"problem.steps={steps} is not accepted; accepted: a multiple of {SEGMENT_LENGTH}")
    return DataSetPlan(
        material_named(options["material"], "problem.material"),
        body=particles(particles_per_edge=edge),
        steps=steps,
        keyframe_every=SEGMENT_LENGTH,
        train_scenes=whole(options, "train_scenes"),
        validation_scenes=1,
        seed=seed,
    )


def _data(plan: DataSetPlan, context: BenchmarkContext) -> dict[str, list[SceneRecord]]:
    """The analytic motion of the scenes of all splits."""
    laws, frames = analytic_laws(plan.material), FramePlan(plan.steps, plan.every, plan.keyframe_every)
    return {
        split: simulate_records(starts, laws, frames, Execution(device=context.device))
        for split, starts in planned_scenes(plan).items()
    }


def _untrained(material: Material, context: BenchmarkContext) -> Laws:
    torch.manual_seed(context.seed)
    laws = build_neural_laws(material, NEURAL_MODEL)
    for law in laws:
        if law is not None:
            law.to(context.device)
    return laws


def _trained(
    material: Material, data: Mapping[str, Sequence[SceneRecord]], iterations: int, context: BenchmarkContext
) -> dict[str, Any]:
    """Seconds of one training, its only check at the end included, and the errors of its law."""
    laws = _untrained(material, context)
    plan = SegmentPlan(iterations, SEGMENTS, first=SEGMENT_LENGTH, last=SEGMENT_LENGTH, seed=context.seed)
    segments = TrajectoryDataModule(data["train"], data["validation"], plan, check_every=iterations)
    module = MultiSceneModule(laws, segments.dataset.settings, OPTIMISER, iterations)
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        try:
            fit(module, segments, Path(folder), context.device, console=Console(quiet=True))
        except SimulationDiverged:
            return {"seconds": time.monotonic() - began, "mse": None, "scenes": []}
        seconds = time.monotonic() - began
    return {"seconds": seconds, **_errors(laws, data["test"], context)}


def _errors(laws: Laws, records: Sequence[SceneRecord], context: BenchmarkContext) -> dict[str, Any]:
    """Mean MSE [m^2] over the unseen scenes, and of each; None where the law diverges."""
    try:
        results = evaluate_records(records, LawSimulator(laws), Execution(device=context.device))
    except SimulationDiverged:
        return {"mse": None, "scenes": []}
    scenes = [{"name": result.name, "mse": result.mse} for result in results]
    return {"mse": sum(scene["mse"] for scene in scenes) / len(scenes), "scenes": scenes}
