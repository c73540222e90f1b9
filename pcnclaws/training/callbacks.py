"""Callbacks of a training run: the loss curve, the best weights, a checkpoint after every validation, and SIGTERM."""

import math
import signal
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import torch
from lightning.pytorch import LightningModule, Trainer
from lightning.pytorch.callbacks import Callback, Checkpoint
from torch import Tensor, nn

from pcnclaws.training.checkpoints import LAST
from pcnclaws.training.watched import WatchedModule
from pcnclaws.training.weights import model_weights


class History(Callback):
    """The numbers of a run: the loss [m^2] of every iteration and the error [m^2] of every check."""

    def __init__(self) -> None:
        self.loss: list[float] = []
        self.check_iteration: list[int] = []
        self.check_mse: list[float] = []
        self._epoch: list[Tensor] = []

    def on_train_epoch_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        self._epoch = []

    def on_train_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        # kept on the device: asking for its value would wait for the device in every iteration
        self._epoch.append(trainer.callback_metrics["loss"])

    def on_validation_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        self.loss += torch.stack(self._epoch).view(-1, trainer.accumulate_grad_batches).mean(1).tolist()
        self.check_iteration.append(trainer.global_step)
        self.check_mse.append(cast(WatchedModule, pl_module).check.mse)

    def state_dict(self) -> dict[str, Any]:
        return {"loss": self.loss, "check_iteration": self.check_iteration, "check_mse": self.check_mse}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        self.loss, self.check_mse = list(state_dict["loss"]), list(state_dict["check_mse"])
        self.check_iteration = list(state_dict["check_iteration"])


class BestWeights(Callback):
    """Remembers the weights of the check with the smallest error, or of a later one that is as good.

    keep       called with itself whenever it takes new weights
    tolerance  a later check is as good up to so many times the smallest error: averaged weights grow better to the end,
               and the error of two scenes, which scatters by such factors, must not choose among them
    """

    def __init__(
        self, model: nn.Module, keep: Callable[["BestWeights"], None] | None = None, tolerance: float = 1.0
    ) -> None:
        self.model, self.keep, self.tolerance = model, keep, tolerance
        self.mse = self.smallest = math.inf
        self.iteration = 0
        self.weights: dict[str, Tensor] = {}

    def on_validation_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        # not at the end of the validation, when weights that were averaged for it are gone again
        mse = cast(WatchedModule, pl_module).check.mse
        if mse < self.tolerance * self.smallest:
            self.mse, self.iteration = mse, trainer.global_step
            self.smallest = min(mse, self.smallest)
            self.weights = model_weights(self.model)
            if self.keep is not None:
                self.keep(self)

    def state_dict(self) -> dict[str, Any]:
        return {"mse": self.mse, "smallest": self.smallest, "iteration": self.iteration, "weights": self.weights}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        self.mse, self.iteration = state_dict["mse"], state_dict["iteration"]
        self.smallest = state_dict.get("smallest", self.mse)
        self.weights = state_dict["weights"]


class CheckpointEachCheck(Checkpoint):
    """Writes checkpoints/last.ckpt at the end of every epoch, after everything else has seen the epoch."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        trainer.save_checkpoint(self.folder / LAST)


class OwnSigterm(Callback):
    """SIGTERM as it was before the training.

    Lightning's handler tells the other processes of a training by a broadcast, which none of them expects: it waits for
    ever, inside the handler.
    """

    def __init__(self) -> None:
        self._handler = signal.getsignal(signal.SIGTERM)

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        if trainer.world_size > 1 and threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGTERM, self._handler)
