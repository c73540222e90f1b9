"""Trains the laws of a material: python -m pcnclaws.train experiment=sand_multi."""

import math
import time
from pathlib import Path
from typing import Any, cast

import torch
from omegaconf import DictConfig, OmegaConf
from rich.console import Console

from pcnclaws import launcher
from pcnclaws.configuration import device_from, material_from, precision_from, skips_from, use_processor, whole_number
from pcnclaws.data.datamodule import TrajectoryDataModule
from pcnclaws.data.dataset import SegmentPlan
from pcnclaws.data_sets import ready_data_set
from pcnclaws.errors import UserError, unknown_name
from pcnclaws.evaluation.provenance import commit
from pcnclaws.laws.materials import Laws, Material
from pcnclaws.models import build_model
from pcnclaws.runs import METRICS, WEIGHTS, is_finished, start_run
from pcnclaws.training.fit import FitResult, fit, quiet_lightning
from pcnclaws.training.module import ConstitutiveModule, OptimiserSettings
from pcnclaws.training.multi_scene import MultiSceneModule
from pcnclaws.training.single_scene import SingleSceneModule
from pcnclaws.training.sources import TrainingScenes, for_regime, generated_scenes, own_scenes
from pcnclaws.training.weights import set_law_weights, write_weights
from pcnclaws.training_report import Report, write_report

REGIMES: dict[str, type[ConstitutiveModule]] = {"multi_scene": MultiSceneModule, "single_scene": SingleSceneModule}
# Width of what is printed where the output is not a terminal.
PLAIN_WIDTH = 120


def train(config: DictConfig) -> None:
    """Makes the data if it is missing, trains, tests, and fills the run folder `output`.

    The same command again continues an unfinished run, and leaves a finished one alone.
    """
    started = time.monotonic()
    commit()  # of the code that trains
    use_processor(config)
    quiet_lightning()
    console = Console(soft_wrap=True) if Console().is_terminal else Console(width=PLAIN_WIDTH, soft_wrap=True)
    folder, plain = Path(config.output), cast(dict[str, Any], OmegaConf.to_container(config))
    regime, optimiser, laws = _regime(config), _optimiser(config), untrained_laws(config)
    _plan(config, config.training.start)  # refuses wrong options before the data is made
    if not config.overwrite and is_finished(folder, plain):
        console.print(f"{folder} holds this run, finished: see {folder / METRICS}; overwrite=true trains it anew")
        return

    scenes = for_regime(_scenes(config), regime, config.regime.scene)
    plan = _plan(config, scenes.start)
    check_every, checks = _check_every(config)
    data = TrajectoryDataModule(scenes.training, scenes.validation, plan, check_every, precision_from(config))
    for note in (*scenes.notes, *checks, f"segments start from {_start_in_words(scenes.start)}"):
        console.print(note)
    start_run(folder, plain, config.overwrite)
    skips = skips_from(config)
    module = regime(laws, data.dataset.settings, optimiser, plan.iterations, skips)
    fitted = fit(module, data, folder, device_from(config), whole_number(config, "logger.every"), console)

    notes = _notes(config, scenes, fitted)
    write_weights(folder / WEIGHTS, fitted.best.weights, notes)
    set_law_weights(laws, fitted.best.weights, str(folder / WEIGHTS))
    report = Report(folder, scenes, fitted, notes, untrained_laws(config), laws, started, skips)
    write_report(report, device_from(config), precision_from(config), config.seed, config.picture, console)


def untrained_laws(config: DictConfig) -> Laws:
    """The laws of `material` and `model.*` as training with `seed` starts from them."""
    torch.manual_seed(whole_number(config, "seed", least=0))
    model = cast(dict[str, Any], OmegaConf.to_container(config.model))
    laws = build_model(material_from(config), model)
    for law in laws:
        if law is not None:
            law.to(device_from(config), precision_from(config))
    return laws


def _regime(config: DictConfig) -> type[ConstitutiveModule]:
    if config.regime.name not in REGIMES:
        raise unknown_name("regime", config.regime.name, REGIMES)
    return REGIMES[config.regime.name]


def _optimiser(config: DictConfig) -> OptimiserSettings:
    training = config.training
    return OptimiserSettings(
        float(training.learning_rate),
        gradient_clip=_number_or_none(training.gradient_clip),
        loss=str(training.loss),
        loss_scale=_number_or_none(training.loss_scale),
        plastic_learning_rate=_number_or_none(training.plastic_learning_rate),
    )


def _number_or_none(value: float | None) -> float | None:
    return None if value is None else float(value)


def _plan(config: DictConfig, start: str) -> SegmentPlan:
    training = config.training
    return SegmentPlan(
        training.iterations,
        training.batch_segments,
        start,
        training.segment_length.first,
        training.segment_length.last,
        training.loss_every,
        config.seed,
    )


def _check_every(config: DictConfig) -> tuple[int, list[str]]:
    """Iterations between two checks: the divisor of training.iterations nearest to training.check_every; a note."""
    wanted, iterations = whole_number(config, "training.check_every"), config.training.iterations
    if iterations == 0:
        return wanted, ["training.iterations=0: nothing is fitted, the run holds the structure of the law alone"]
    divisors = [n for n in range(1, iterations + 1) if iterations % n == 0]
    nearest = min(divisors, key=lambda n: abs(math.log(n / wanted)))
    note = f"checks every {nearest} iterations, which divides training.iterations={iterations}"
    return nearest, [] if nearest == wanted else [note]


def _scenes(config: DictConfig) -> TrainingScenes:
    """The user's own scenes where data.trajectories names them, the generated data set otherwise."""
    material: Material = material_from(config)
    if config.data.trajectories is None:
        return generated_scenes(ready_data_set(config), material, config.training.start)
    named = config.data.trajectories
    paths = OmegaConf.create([named]) if isinstance(named, str) else named
    if not OmegaConf.is_list(paths) or not all(isinstance(path, str) for path in paths) or not len(paths):
        raise UserError(
            f"data.trajectories={named} is not accepted; accepted: the path of a trajectory file, or a list of them"
        )
    return own_scenes([Path(path) for path in paths], material, config.training.start)


def _notes(config: DictConfig, scenes: TrainingScenes, fitted: FitResult) -> dict[str, Any]:
    """What is kept beside the weights: what they are weights of, and how they came about."""
    return {
        "material": config.material.name,
        "regime": config.regime.name,
        "training_start": scenes.start,
        "positions_only": scenes.start == "initial",
        "training_scenes": len(scenes.training),
        "ranges": {name: list(span) for name, span in scenes.ranges.items()},
        "iterations": config.training.iterations,
        "best_iteration": fitted.best.iteration,
        "validation_mse": fitted.best.mse,
        "skipped_iterations": fitted.skipped,
    }


def _start_in_words(start: str) -> str:
    return "recorded full states (keyframes)" if start == "keyframes" else "the initial state (positions only)"


def main() -> None:
    """The command."""
    launcher.main(train, "train")


if __name__ == "__main__":
    main()
