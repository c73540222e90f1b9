"""Laws of a material trained on recorded motions of a data set, and their errors on others."""

import tempfile
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
from pcnclaws.training.levenberg_marquardt import LevenbergMarquardtModule
from pcnclaws.training.loop import Loop
from pcnclaws.training.module import OptimiserSettings
from pcnclaws.training.multi_scene import MultiSceneModule
from pcnclaws.training.sources import show_deformations
from pcnclaws.training.trainer import fit
from pcnclaws.training.weights import set_model_weights

EVERY, KEYFRAME_EVERY = 5, 20
# As in conf/training/short.yaml and initial.yaml.
SHORT = {"segments": 8, "first": 5, "last": 5}
# As in conf/training/levenberg_marquardt.yaml.
LEAST_SQUARES = {"segments": 12, "start": "initial", "first": 200, "last": 300}
INITIAL = {"segments": 2, "start": "initial", "first": 150, "last": 400}

Motions = dict[str, list[SceneRecord]]


class Recipe(NamedTuple):
    """How a law is trained: from full states as `training=short`, or from positions alone as `training=initial`.

    least_squares  from positions as `training=levenberg_marquardt`
    """

    model: str = "pcnclaws"
    loss: str = "relative"
    positions_only: bool = False
    least_squares: bool = False


class Trained(NamedTuple):
    """Squared errors of a trained law on each test object [m^2], none where one diverges, and the scenes it names."""

    errors: list[float]
    named: list[str]

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
    torch.manual_seed(context.seed)
    model = build_model(material, {"name": recipe.model})
    laws = model.laws
    assert laws is not None  # noqa: S101
    show_deformations(laws.elasticity, motions["train"])
    least = recipe.least_squares
    segmented = LEAST_SQUARES if least else INITIAL if recipe.positions_only else SHORT
    plan = SegmentPlan(iterations, seed=context.seed, **segmented)  # pyright: ignore[reportArgumentType]
    precision, check_every = (torch.float64, 1) if least else (torch.float32, max(iterations // 4, 1))
    segments = TrajectoryDataModule(motions["train"], motions["validation"], plan, check_every, precision)
    rate = 3e-3 if recipe.positions_only else 5e-3
    settings = OptimiserSettings(rate, gradient_clip=None if least else 10.0, loss=recipe.loss)
    kind = LevenbergMarquardtModule if least else MultiSceneModule
    module = kind(laws, segments.dataset.settings, settings, iterations)
    loop = Loop(logger="csv", average=None if recipe.positions_only or least else 8.0, pictures=False)
    try:
        with tempfile.TemporaryDirectory() as folder:
            found = fit(module, segments, Path(folder), context.device, loop, console=Console(quiet=True))
        set_model_weights(model, found.best.weights, "the best weights")
        errors = [one.mse for one in evaluate_records(motions["test"], model)]
    except SimulationDiverged:
        errors = []
    return Trained(errors, sorted(module.contradicting()))


def positions_alone(records: Sequence[SceneRecord]) -> list[SceneRecord]:
    """The records without velocities and full states after the start."""
    return [replace(record, keyframes=None, velocity=None) for record in records]
