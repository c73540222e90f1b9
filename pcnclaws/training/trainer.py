"""Training loop: Lightning's trainer with our callbacks, from scratch or from the newest checkpoint."""

import logging
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import torch
from rich.console import Console

from pcnclaws.data.datamodule import CheckedDataModule
from pcnclaws.errors import Interrupted, SimulationDiverged, is_full
from pcnclaws.training.averaging import AveragedWeights
from pcnclaws.training.budget import WallClock
from pcnclaws.training.callbacks import BestWeights, CheckpointEachCheck, History, OwnSigterm
from pcnclaws.training.checkpoints import LAST, AtomicCheckpointIO, Resumption, newest_checkpoint
from pcnclaws.training.loop import Loop
from pcnclaws.training.progress import TrainingProgress
from pcnclaws.training.watched import WatchedModule
from pcnclaws.training.weights import model_weights

log = logging.getLogger(__name__)

DEFAULT_LOOP = Loop()
# By which factor the error of a check scatters from one to the next, where weights are averaged.
AS_GOOD = 4.0


@dataclass(frozen=True)
class FitResult:
    """What a finished run leaves: its curves, its best weights, and how many iterations were skipped.

    stopped  why it ended before its last iteration, None where it did not
    """

    history: History
    best: BestWeights
    skipped: int
    stopped: str | None = None


def fit(
    module: WatchedModule,
    data: CheckedDataModule,
    folder: Path,
    device: torch.device,
    loop: Loop = DEFAULT_LOOP,
    *,
    console: Console | None = None,
    clock: WallClock | None = None,
    keep: Callable[[BestWeights], None] | None = None,
    to_beat: float | None = None,
) -> FitResult:
    """Trains the module's model and leaves the best weights in them; without iterations, checks them as they are.

    A run whose gradients cease to be finite keeps what its best check found.

    folder    the run folder: checkpoints and what the logger keeps go there, and an unfinished run is continued
    clock     what may end the run before its iterations do
    to_beat   error of the model as it is, for a trained one: its weights are kept unless a check is better
    keep      called with the best weights so far whenever a check is better than those before it
    raises    SimulationDiverged if no check of the run was finite
    """
    if data.iterations == 0:
        return _untrained(module, data)
    console = console or Console()
    averaged = [] if loop.average is None else [AveragedWeights(loop.average)]
    history, best = History(), BestWeights(module.model, keep, AS_GOOD if averaged and to_beat is None else 1.0)
    if to_beat is not None:
        best.mse = best.smallest = to_beat
        best.weights = model_weights(module.model)
    checkpoints = folder / "checkpoints"
    checkpoint = newest_checkpoint(checkpoints)
    resumption = Resumption(checkpoint)
    clock = clock or WallClock(None)
    progress = TrainingProgress(data.iterations, console, clock)
    trainer = loop.made_trainer(
        accelerator="gpu" if device.type == "cuda" else "cpu",
        devices=1,
        use_distributed_sampler=False,  # batches are divided, not given out
        plugins=[AtomicCheckpointIO()],
        max_epochs=data.epochs,
        gradient_clip_val=module.gradient_clip,
        logger=loop.made_logger(folder),
        log_every_n_steps=min(loop.log_every, data.check_every),
        num_sanity_val_steps=0,
        callbacks=[
            resumption,
            history,
            best,  # before the averages, which it sees only until they are gone
            *averaged,
            clock,
            *loop.made_callbacks(),
            CheckpointEachCheck(checkpoints),
            OwnSigterm(),
            progress,
        ],
        enable_checkpointing=True,
        enable_progress_bar=False,
        enable_model_summary=False,
    )
    stopped = None
    with warnings.catch_warnings():
        # a batch is made in a millisecond: worker processes would cost more than they save
        warnings.filterwarnings("ignore", message=".*does not have many workers.*")
        warnings.filterwarnings("ignore", message="Experiment logs directory .* exists and is not empty.*")  # goes on
        warnings.filterwarnings("ignore", message=".*treespec, LeafSpec.*")  # Lightning's own business
        try:
            with interruptible(checkpoints), resumption.one_line_faults():
                trainer.fit(module, datamodule=data, ckpt_path=checkpoint, weights_only=True)
        except SimulationDiverged as divergence:
            if not best.weights:
                raise
            stopped = str(divergence)
            log.warning("%s; the law of iteration %d, whose check was the best, is kept", stopped, best.iteration)
    if not best.weights:
        raise SimulationDiverged(
            "training failed: every check of the run diverged; "
            "lower training.learning_rate or train for more iterations"
        )
    return FitResult(history, best, module.skipped, stopped)


@contextmanager
def interruptible(checkpoints: Path) -> Iterator[None]:
    """Notes what was kept of a fit that is interrupted, and which file it was that found no room.

    Lets Ctrl-C through, which Lightning turns into an exit of the process without a word of what happened.
    """
    try:
        yield
    except SystemExit as end:
        if isinstance(end.__context__, KeyboardInterrupt):
            raise end.__context__ from None
        raise
    except Interrupted as end:
        kept = checkpoints / LAST
        if kept.is_file():
            end.add_note(f"the same command goes on from {kept}")
        raise
    except OSError as error:
        if is_full(error) and error.filename is None:  # checkpoints say themselves what they are
            error.filename = str(checkpoints.with_name("tensorboard"))
        raise


def _untrained(module: WatchedModule, data: CheckedDataModule) -> FitResult:
    """The model as it is, with the error of one check."""
    history, best = History(), BestWeights(module.model)
    best.mse, best.weights = module.checked(data.validation).mse, model_weights(module.model)
    history.check_iteration, history.check_mse = [0], [best.mse]
    return FitResult(history, best, module.skipped)


def quiet_lightning() -> None:
    """Lightning's announcements of what hardware it found are not for the users of this package."""
    logging.getLogger("lightning.pytorch").setLevel(logging.WARNING)
    logging.getLogger("lightning.fabric").setLevel(logging.WARNING)
