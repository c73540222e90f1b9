"""Laws of a material trained on recorded motions of a data set, and their errors on others."""

import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import torch
from rich.console import Console

from benchmarks.context import BenchmarkContext
from pcnclaws.commands.models import build_model
from pcnclaws.data.datamodule import TrajectoryDataModule
from pcnclaws.data.sampling import DataSetPlan, planned_scenes
from pcnclaws.data.segments import SegmentPlan
from pcnclaws.errors import SimulationDiverged
from pcnclaws.evaluation.tasks import evaluate_records
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.materials import Material
from pcnclaws.simulation.execution import Execution
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.training.kalman import KalmanModule
from pcnclaws.training.levenberg_marquardt import LevenbergMarquardtModule
from pcnclaws.training.loop import Loop
from pcnclaws.training.module import OptimiserSettings
from pcnclaws.training.multi_scene import MultiSceneModule
from pcnclaws.training.sources import show_deformations
from pcnclaws.training.trainer import fit
from pcnclaws.training.weights import set_model_weights

EVERY, KEYFRAME_EVERY = 5, 20
# As in conf/training/short.yaml, kalman.yaml and initial.yaml.
SHORT = {"segments": 8, "first": 5, "last": 5}
# As in conf/training/levenberg_marquardt.yaml.
LEAST_SQUARES = {"segments": 12, "start": "initial", "first": 200, "last": 300}
INITIAL = {"segments": 2, "start": "initial", "first": 150, "last": 400}

METHODS: dict[str, type[MultiSceneModule]] = {
    "adam": MultiSceneModule,
    "kalman": KalmanModule,
    "levenberg_marquardt": LevenbergMarquardtModule,
}

Motions = dict[str, list[SceneRecord]]


class Recipe(NamedTuple):
    """How a law is trained: from full states as `training=short`, or from positions alone as `training=initial`.

    rate, average  learning rate, and power of the average of weights; None: those of these files
    method   as training.method; 'kalman' with the segments of `training=kalman`, which are those of `training=short`;
             'levenberg_marquardt' with those of `training=levenberg_marquardt`, from positions
    seed     of the weights and of the segments, None for that of the benchmark
    checks   of the training; the best one is kept
    """

    model: str = "pcnclaws"
    loss: str = "relative"
    positions_only: bool = False
    rate: float | None = None
    average: float | None = None
    method: str = "adam"
    seed: int | None = None
    checks: int = 4


class Trained(NamedTuple):
    """A trained law.

    errors       squared errors on each test object [m^2], none where one diverges
    named        the scenes that contradict the others
    checked      error of the validation scenes [m^2], None where no check was finite
    cpu_seconds  of the processor, its checks included
    """

    errors: list[float]
    named: list[str]
    checked: float | None
    cpu_seconds: float

    @property
    def mean(self) -> float | None:
        return sum(self.errors) / len(self.errors) if self.errors else None


def recorded_motions(material: Material, scenes: int, steps: int, context: BenchmarkContext) -> Motions:
    """Motions by the analytic laws, of each split: to train on, two to check with, and the material's test objects."""
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


def trained(
    material: Material, motions: Motions, recipe: Recipe, iterations: int, context: BenchmarkContext
) -> Trained:
    """The errors, on the motions of "test", of a law trained on those of "train" and checked with "validation"."""
    seed = context.seed if recipe.seed is None else recipe.seed
    torch.manual_seed(seed)
    model = build_model(material, {"name": recipe.model})
    laws = model.laws
    assert laws is not None  # noqa: S101
    show_deformations(laws.elasticity, motions["train"])
    least = recipe.method == "levenberg_marquardt"
    segmented = LEAST_SQUARES if least else INITIAL if recipe.positions_only else SHORT
    plan = SegmentPlan(iterations, seed=seed, **segmented)  # pyright: ignore[reportArgumentType]
    every, precision = (1, torch.float64) if least else (max(iterations // recipe.checks, 1), torch.float32)
    segments = TrajectoryDataModule(motions["train"], motions["validation"], plan, every, precision)
    rate = 3e-3 if recipe.positions_only else 5e-3
    average = None if recipe.positions_only or least else 8.0
    clip = 10.0 if recipe.method == "adam" else None
    settings = OptimiserSettings(recipe.rate or rate, gradient_clip=clip, loss=recipe.loss)
    module = METHODS[recipe.method](laws, segments.dataset.settings, settings, iterations)
    loop = Loop(logger="csv", average=recipe.average or average, pictures=False)
    began, checked, errors = time.process_time(), None, []
    try:
        with tempfile.TemporaryDirectory() as folder:
            best = fit(module, segments, Path(folder), context.device, loop, console=Console(quiet=True)).best
        set_model_weights(model, best.weights, "the best weights")
        checked, seconds = best.mse, time.process_time() - began
        errors = [one.mse for one in evaluate_records(motions["test"], model)]
    except SimulationDiverged:
        seconds = time.process_time() - began
    return Trained(errors, sorted(module.contradicting()), checked, seconds)


def positions_alone(records: Sequence[SceneRecord]) -> list[SceneRecord]:
    """The records without velocities and full states after the start."""
    return [replace(record, keyframes=None, velocity=None) for record in records]
