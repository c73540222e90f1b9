"""Training run: data, fit, test on unseen objects and the run folder."""

import copy
import math
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from rich.console import Console

from pcnclaws.baselines.identified import identified_values
from pcnclaws.commands.choices import import_plugins
from pcnclaws.commands.configuration import (
    device_from,
    execution_from,
    use_processor,
)
from pcnclaws.commands.options import is_free, leaves
from pcnclaws.commands.outputs import check_ending
from pcnclaws.commands.runs import CHECKPOINTS, METRICS, WEIGHTS, goes_on, is_finished, run_errors, start_run
from pcnclaws.commands.stress_training import train_on_stress
from pcnclaws.commands.training_inputs import inputs_of, scenes_of
from pcnclaws.commands.training_report import Report, against_untrained, write_report
from pcnclaws.commands.training_setup import Setup, check_training, loop_from, setup
from pcnclaws.commands.typed import plain
from pcnclaws.commands.typed_configs import TrainConfig
from pcnclaws.data.locks import written_alone
from pcnclaws.provenance import commit
from pcnclaws.training.callbacks import BestWeights
from pcnclaws.training.checkpoints import check_interval, newest_checkpoint
from pcnclaws.training.hyperparameters import log_hyperparameters
from pcnclaws.training.processes import beside
from pcnclaws.training.sources import TrainingScenes
from pcnclaws.training.trainer import FitResult, fit, quiet_lightning
from pcnclaws.training.weights import set_model_weights, write_weights

# Width of what is printed where the output is not a terminal.
PLAIN_WIDTH = 120


def train(config: TrainConfig) -> Mapping[str, float | None]:
    """Makes the data if it is missing, trains, tests, and fills the run folder `output`; returns the errors of the law.

    The same command again continues an unfinished run, and leaves a finished one alone.
    """
    folder = Path(config.output)
    with written_alone(folder, f"output={folder}"):
        if config.data.stress is not None:
            return train_on_stress(config)
        _train(config)
        return {f"{name} [m^2]": error for name, error in run_errors(folder).items()}


def _train(config: TrainConfig) -> None:
    started = time.monotonic()
    commit()  # of the code that trains
    use_processor(config)
    quiet_lightning()
    console = Console(soft_wrap=True) if Console().is_terminal else Console(width=PLAIN_WIDTH, soft_wrap=True)
    folder = Path(config.output)
    check_ending("output", folder)
    check_training(config)
    inputs = inputs_of(config)
    config, model, initial = inputs.config, inputs.model, inputs.initial
    options = plain(config)
    if not config.overwrite and is_finished(folder, options):
        console.print(f"{folder} holds this run, finished: see {folder / METRICS}; overwrite=true trains it anew")
        return

    scenes = scenes_of(inputs)
    more = not config.overwrite and goes_on(folder, options)
    interval = _interval_before(folder) if more else None
    prepared = setup(config, model, scenes, interval)
    for note in (*scenes.notes, *inputs.notes, *prepared.notes):
        console.print(note)
    if more:  # it is not finished until the longer run is
        (folder / METRICS).unlink(missing_ok=True)
    start_run(folder, options, config.overwrite)
    untrained, untrained_mse = copy.deepcopy(model), _check_before(config, prepared, console)
    loop = loop_from(config)
    with beside(
        loop.processes if config.training.iterations else 1, train_beside, replace(config, threads=None), interval
    ):
        fitted = fit(
            prepared.module,
            prepared.data,
            folder,
            device_from(config.device),
            loop,
            console=console,
            clock=prepared.clock,
            to_beat=None if initial is None else untrained_mse,
            keep=lambda best: _keep(config, scenes, folder, best),
        )

    notes = _notes(config, scenes, fitted)
    write_weights(folder / WEIGHTS, fitted.best.weights, notes)
    set_model_weights(model, fitted.best.weights, str(folder / WEIGHTS))
    notes |= against_untrained(fitted.best.mse, untrained_mse) | {"training_seconds": round(prepared.clock.spent, 1)}
    notes |= {"contradicting_scenes": prepared.module.contradicting()}
    notes |= {"identified": found} if model.laws is not None and (found := identified_values(model.laws)) else {}
    report = Report(
        folder,
        scenes,
        fitted,
        notes,
        untrained=untrained,
        trained=model,
        started=started,
        execution=execution_from(config),
    )
    write_report(report, config.seed, config.picture, console)
    shown = {option: value for option, value in leaves(options) if not is_free(option)}
    if config.logger.name == "tensorboard":
        log_hyperparameters(folder, shown, run_errors(folder))


def train_beside(config: TrainConfig, interval: int | None) -> None:
    """The part of a training in a further process: its share of every batch and of every check, and no files.

    config    as the first process has settled it
    interval  iterations between the checks of a run that goes on for longer
    """
    quiet_lightning()
    use_processor(config)
    import_plugins(config.plugins)
    inputs = inputs_of(config)
    prepared = setup(inputs.config, inputs.model, scenes_of(inputs), interval)
    folder, device = Path(config.output), device_from(config.device)
    fit(prepared.module, prepared.data, folder, device, loop_from(config), clock=prepared.clock)


def _check_before(config: TrainConfig, prepared: Setup, console: Console) -> float | None:
    """The error of the untrained model that the checks compare with [m^2]; None where nothing is trained."""
    if not config.training.iterations:
        return None
    mse = prepared.module.checked(prepared.data.validation).mse
    console.print(
        f"before training: check {mse:.2e} m²" if math.isfinite(mse) else "before training: the check diverges"
    )
    return mse


def _interval_before(folder: Path) -> int | None:
    """Iterations between the checks of the run in a folder; None where it has had none."""
    checkpoint = newest_checkpoint(folder / CHECKPOINTS)
    return None if checkpoint is None else check_interval(checkpoint)


def _keep(config: TrainConfig, scenes: TrainingScenes, folder: Path, best: BestWeights) -> None:
    """Writes the best weights so far, which may be used while the training goes on."""
    write_weights(folder / WEIGHTS, best.weights, _origin(config, scenes, best) | {"unfinished": True})


def _notes(config: TrainConfig, scenes: TrainingScenes, fitted: FitResult) -> dict[str, Any]:
    """What is kept beside the weights: what they are weights of, and how they came about."""
    return _origin(config, scenes, fitted.best) | {
        "iterations": _iterations(config, fitted),
        "skipped_iterations": fitted.skipped,
        "stopped": fitted.stopped,
    }


def _origin(config: TrainConfig, scenes: TrainingScenes, best: BestWeights) -> dict[str, Any]:
    return {
        "material": config.material.name,
        "regime": config.regime.name,
        "training_start": config.training.start,
        "positions_only": config.training.start == "initial",
        "training_scenes": len(scenes.training),
        "ranges": {name: list(span) for name, span in scenes.ranges.items()},
        "init": config.training.init,
        "best_iteration": best.iteration,
        "validation_mse": best.mse,
    }


def _iterations(config: TrainConfig, fitted: FitResult) -> int:
    """How many were done: all of them, unless the clock or a callback ended the training."""
    may_end = config.training.seconds is not None or config.callbacks.early_stopping.patience is not None
    checks = fitted.history.check_iteration
    return checks[-1] if may_end and checks else config.training.iterations
