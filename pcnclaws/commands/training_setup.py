"""Module, batches and clock of a training run, from typed options."""

import math
from typing import NamedTuple, TypeAlias

import torch

from pcnclaws.commands.configuration import precision_from, skips_from, whole_number
from pcnclaws.commands.runs import as_laws
from pcnclaws.commands.typed_configs import TrainConfig
from pcnclaws.data.datamodule import CheckedDataModule, TrajectoryDataModule
from pcnclaws.data.dataset import SegmentDataset
from pcnclaws.data.segments import SegmentPlan
from pcnclaws.errors import UserError, unknown_name
from pcnclaws.laws.analytic import Laws
from pcnclaws.simulation.motion import MotionModel, SceneSimulator
from pcnclaws.training.budget import WallClock
from pcnclaws.training.gauss_newton import GaussNewtonModule
from pcnclaws.training.kalman import KalmanModule
from pcnclaws.training.levenberg_marquardt import LevenbergMarquardtModule
from pcnclaws.training.loop import Loop
from pcnclaws.training.module import ConstitutiveModule, OptimiserSettings
from pcnclaws.training.multi_scene import MultiSceneModule
from pcnclaws.training.one_step import OneStepModule
from pcnclaws.training.single_scene import SingleSceneModule
from pcnclaws.training.sources import TrainingScenes, show_deformations
from pcnclaws.training.watched import WatchedModule

REGIMES: dict[str, type[ConstitutiveModule]] = {"multi_scene": MultiSceneModule, "single_scene": SingleSceneModule}
# What finds the weights; None is the regime's own, by gradients.
METHODS: dict[str, type[ConstitutiveModule] | None] = {
    "adam": None,
    "gauss_newton": GaussNewtonModule,
    "kalman": KalmanModule,
    "levenberg_marquardt": LevenbergMarquardtModule,
}
# Noise of the positions that a model of motion is trained with, unless training.noise says another [m].
NO_NOISE = 0.0


# A module, its batches, and notes for the user.
Prepared: TypeAlias = tuple[WatchedModule, CheckedDataModule, tuple[str, ...]]


class Setup(NamedTuple):
    """What a run trains with, and what the user should know about it, one line each."""

    module: WatchedModule
    data: CheckedDataModule
    clock: WallClock
    notes: tuple[str, ...]


def regime_from(config: TrainConfig) -> type[ConstitutiveModule]:
    """The regime of `regime=`."""
    if config.regime.name not in REGIMES:
        raise unknown_name("regime", config.regime.name, REGIMES)
    return REGIMES[config.regime.name]


def check_training(config: TrainConfig) -> None:
    """Refuses wrong options of `training.*` before any data is made."""
    if config.training.method not in METHODS:
        raise unknown_name("training.method", config.training.method, METHODS)
    _plan(config)
    _optimiser(config)
    _budget(config)
    _noise(config)
    loop_from(config)


def loop_from(config: TrainConfig) -> Loop:
    """The settings of `trainer.*`, `callbacks.*` and `logger.*`."""
    early = config.callbacks.early_stopping
    patience = early.patience
    if patience is not None:
        patience = whole_number(patience, "callbacks.early_stopping.patience")
    if early.min_delta is not None and not isinstance(early.min_delta, (int, float)):
        raise UserError(
            f"callbacks.early_stopping.min_delta={early.min_delta} is not accepted; accepted: a number from 0 [m^2]"
        )
    return Loop(
        trainer={name: value for name, value in config.trainer.items() if value is not None},
        logger=config.logger.name,
        log_every=whole_number(config.logger.every, "logger.every"),
        project=config.logger.project,
        patience=patience,
        min_delta=float(early.min_delta or 0.0),
        average=_number_or_none(config.training.average),
        pictures=config.picture,
    )


def setup(config: TrainConfig, model: SceneSimulator, scenes: TrainingScenes, check_every: int | None = None) -> Setup:
    """What trains the model: by single steps where it learns from them, else its laws through the simulation.

    check_every  iterations between the checks of a run that is to go on for longer, None for a new one
    """
    every, notes = _check_every(config) if check_every is None else _as_before(config, check_every)
    clock = WallClock(_budget(config))
    stepwise = model.one_step
    if stepwise is not None:
        module, data, more = _one_step(config, stepwise, scenes, every, clock)
    else:
        module, data, more = _simulated(config, as_laws(model, f"model={config.model['name']}"), scenes, every)
    return Setup(module, data, clock, (*notes, *more))


def _simulated(config: TrainConfig, laws: Laws, scenes: TrainingScenes, check_every: int) -> Prepared:
    show_deformations(laws.elasticity, scenes.training, beside=config.training.init is not None)
    plan, method = _plan(config), METHODS[config.training.method]
    least_squares = method is not None and issubclass(method, GaussNewtonModule)
    precision = torch.float64 if least_squares else precision_from(config.precision)
    data = TrajectoryDataModule(scenes.training, scenes.validation, plan, check_every, precision)
    data.dataset.internal_variables = laws.internal_variables
    settings = data.dataset.settings
    if method is not None:
        _check_alone(config, f"training.method={config.training.method}")
    module = (method or regime_from(config))(
        laws, settings, _optimiser(config), plan.iterations, skips_from(config.simulation)
    )
    return module, data, (*data.dataset.notes, _segments_in_words(data.dataset)) if plan.iterations else ()


def _one_step(
    config: TrainConfig, model: MotionModel, scenes: TrainingScenes, check_every: int, clock: WallClock
) -> Prepared:
    training = config.training
    _check_alone(config, f"model={config.model['name']}")
    iterations, batch = training.iterations, whole_number(config.training.batch_segments, "training.batch_segments")
    windows = model.windows(scenes.training, iterations, batch, _noise(config), config.seed)
    data = CheckedDataModule(windows, iterations, scenes.validation, check_every)
    optimiser = _optimiser(config)
    module = OneStepModule(model, optimiser.learning_rate, optimiser.gradient_clip, iterations, clock)
    return module, data, ("trains on frames and the next ones: positions only",)


def _check_alone(config: TrainConfig, option: str) -> None:
    """Refuses several processes, and several batches an iteration, for a training that cannot be divided."""
    if loop_from(config).processes > 1:
        devices = config.trainer.get("devices")
        raise UserError(f"trainer.devices={devices} is not accepted with {option}, which trains in one; accepted: 1")
    batches = config.trainer.get("accumulate_grad_batches")
    if batches not in (None, 1):
        raise UserError(f"trainer.accumulate_grad_batches={batches} is not accepted with {option}; accepted: 1")


def _segments_in_words(dataset: SegmentDataset) -> str:
    """How long the segments are, as the frames and the motions allow, and what they start from."""
    first, last = dataset.lengths
    words = (
        "the initial state (positions only)" if dataset.plan.start == "initial" else "recorded full states (keyframes)"
    )
    return f"segments of {first if first == last else f'{first} to {last}'} steps start from {words}"


def _optimiser(config: TrainConfig) -> OptimiserSettings:
    training = config.training
    return OptimiserSettings(
        float(training.learning_rate),
        gradient_clip=_number_or_none(training.gradient_clip),
        loss=training.loss,
        loss_scale=_number_or_none(training.loss_scale),
        plastic_learning_rate=_number_or_none(training.plastic_learning_rate),
        step_back=bool(training.step_back),
    )


def _plan(config: TrainConfig) -> SegmentPlan:
    training = config.training
    return SegmentPlan(
        iterations=training.iterations,
        segments=training.batch_segments,
        start=training.start,
        first=training.segment_length.first,
        last=training.segment_length.last,
        frame_every=training.loss_every,
        seed=config.seed,
    )


def _check_every(config: TrainConfig) -> tuple[int, tuple[str, ...]]:
    """Iterations between two checks: the divisor of training.iterations nearest to training.check_every; a note."""
    wanted, iterations = whole_number(config.training.check_every, "training.check_every"), config.training.iterations
    if iterations == 0:
        return wanted, ("training.iterations=0: nothing is fitted, the run holds the untrained model",)
    divisors = [n for n in range(1, iterations + 1) if iterations % n == 0]
    nearest = min(divisors, key=lambda n: abs(math.log(n / wanted)))
    note = f"checks every {nearest} iterations, which divides training.iterations={iterations}"
    return nearest, () if nearest == wanted else (note,)


def _as_before(config: TrainConfig, every: int) -> tuple[int, tuple[str, ...]]:
    """The check interval of a run that goes on, and a note."""
    iterations = config.training.iterations
    if iterations % every:
        raise UserError(
            f"training.iterations={iterations} is not accepted: the run has checks every {every} iterations; accepted: "
            f"a multiple of {every}"
        )
    return every, (f"goes on to training.iterations={iterations}, with checks every {every}",)


def _budget(config: TrainConfig) -> float | None:
    seconds = _number_or_none(config.training.seconds)
    if seconds is not None and not seconds > 0.0:
        raise UserError(
            f"training.seconds={seconds} is not accepted; accepted: a positive number, or null for no limit"
        )
    return seconds


def _noise(config: TrainConfig) -> float:
    noise = config.training.noise or NO_NOISE
    if not noise >= 0.0:
        raise UserError(f"training.noise={noise} is not accepted; accepted: a number from 0 [m]")
    return noise


def _number_or_none(value: float | int | None) -> float | None:
    return None if value is None else float(value)
