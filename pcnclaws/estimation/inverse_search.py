"""One search for the unknowns: Lightning's trainer around InverseModule, from the guess or from a checkpoint."""

import logging
import warnings
from pathlib import Path
from typing import Any, cast

from lightning.pytorch import LightningModule, Trainer
from lightning.pytorch.callbacks import Callback
from lightning.pytorch.loggers import TensorBoardLogger
from rich.console import Console
from torch.utils.data import DataLoader, Dataset

from pcnclaws.estimation.inverse import InverseModule
from pcnclaws.training.callbacks import CheckpointEachCheck
from pcnclaws.training.checkpoints import AtomicCheckpointIO, Resumption, newest_checkpoint
from pcnclaws.training.trainer import interruptible

log = logging.getLogger(__name__)


def fit_inverse(module: InverseModule, folder: Path, console: Console) -> None:
    """Searches until it converges, or for as many iterations as the estimator may take.

    folder  checkpoints/ and tensorboard/ are written there; a search that was interrupted goes on
    """
    checkpoints = folder / "checkpoints"
    checkpoint = newest_checkpoint(checkpoints)
    resumption = Resumption(checkpoint)
    trainer = Trainer(
        accelerator="cpu",
        devices=1,
        plugins=[AtomicCheckpointIO()],
        max_epochs=module.estimator.iterations,
        logger=TensorBoardLogger(folder, name="tensorboard", version=""),
        log_every_n_steps=1,
        callbacks=[resumption, CheckpointEachCheck(checkpoints), _Lines(console)],
        enable_progress_bar=False,
        enable_model_summary=False,
    )
    with warnings.catch_warnings():
        # one item, made in no time
        warnings.filterwarnings("ignore", message=".*does not have many workers.*")
        warnings.filterwarnings("ignore", message=".*configure_optimizers. returned .None.*")
        warnings.filterwarnings("ignore", message=".*treespec, LeafSpec.*")
        with interruptible(checkpoints), resumption.one_line_faults():
            trainer.fit(module, DataLoader(_Once()), ckpt_path=checkpoint, weights_only=True)


class _Once(Dataset[int]):
    """The one item of an epoch: an iteration needs no data but the observation."""

    def __len__(self) -> int:
        return 1

    def __getitem__(self, index: int) -> int:
        return 0


class _Lines(Callback):
    """One line for each of the first iterations, and for every tenth of many."""

    def __init__(self, console: Console) -> None:
        self.console = console

    def on_train_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        module, count = cast(InverseModule, pl_module), trainer.current_epoch + 1
        if count > 10 and count % 10:
            return
        values, mse = module.history[-1]
        named = zip(module.problem.unknowns.sought, values, strict=True)
        words = "  ".join(f"{unknown.label} {value:.4g}" for unknown, value in named if not unknown.is_motion)
        self.console.print(f"iteration {count}/{module.estimator.iterations}  {words}  MSE {mse:.2e} m²", markup=False)
