"""Loop settings of a training: Lightning's loggers, callbacks and Trainer options, by name and by plain values."""

import inspect
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from lightning.fabric.utilities.exceptions import MisconfigurationException
from lightning.pytorch import Callback, Trainer
from lightning.pytorch.callbacks import EarlyStopping
from lightning.pytorch.loggers import CSVLogger, Logger, TensorBoardLogger, WandbLogger

from pcnclaws.errors import UserError, not_installed, unknown_name
from pcnclaws.training.averaging import AveragedWeights
from pcnclaws.training.dashboard import Dashboard

LOGGERS = ("tensorboard", "csv", "wandb")
# Options of the Trainer that options of ours set.
OURS = {
    "max_epochs": "training.iterations",
    "max_time": "training.seconds",
    "gradient_clip_val": "training.gradient_clip",
    "check_val_every_n_epoch": "training.check_every",
    "val_check_interval": "training.check_every",
    "log_every_n_steps": "logger.every",
    "logger": "logger=",
    "callbacks": "callbacks=",
    "default_root_dir": "output",
}
# How devices work together: each has a share of every batch, and all have the same weights.
STRATEGIES = ("auto", "ddp")
# Those without which a run could not be continued, or would print over our progress.
FIXED = (
    "use_distributed_sampler",
    "plugins",
    "enable_checkpointing",
    "enable_progress_bar",
    "enable_model_summary",
    "num_sanity_val_steps",
)


@dataclass(frozen=True)
class Loop:
    """How Lightning runs a training, beside what every run has.

    trainer    further options of its Trainer, plain values
    logger     one of LOGGERS
    log_every  iterations from one entry of the logger to the next
    project    of Weights & Biases
    patience   validations without a better one after which a training ends, None for never
    min_delta  by how much one must be better [m^2]
    average    power of AveragedWeights, None for the weights as they are
    pictures   whether TensorBoard is given pictures and point clouds of the validation scenes
    raises     UserError
    """

    trainer: Mapping[str, Any] = field(default_factory=dict)
    logger: str = "tensorboard"
    log_every: int = 10
    project: str | None = None
    patience: int | None = None
    min_delta: float = 0.0
    average: float | None = None
    pictures: bool = True

    def __post_init__(self) -> None:
        if self.logger not in LOGGERS:
            raise unknown_name("logger.name", self.logger, LOGGERS)
        if self.logger == "wandb" and find_spec("wandb") is None:
            raise not_installed("logger=wandb", "wandb", "wandb", "logger=tensorboard or logger=csv")
        if self.average is not None:
            AveragedWeights(self.average)  # refuses what is none
        if not self.min_delta >= 0.0:
            raise UserError(
                f"callbacks.early_stopping.min_delta={self.min_delta} is not accepted; accepted: a number from 0 [m^2]"
            )
        known = set(inspect.signature(Trainer.__init__).parameters) - {"self", *OURS, *FIXED}
        for name in self.trainer:
            if name in OURS:
                raise UserError(f"trainer.{name} is not accepted; accepted: {OURS[name]}, which sets it")
            if name not in known:
                raise unknown_name("trainer", name, known)
        if self.trainer.get("strategy", "auto") not in STRATEGIES:
            raise unknown_name("trainer.strategy", self.trainer["strategy"], STRATEGIES)
        if self.trainer:  # before any data is made
            made = self.made_trainer(logger=False, enable_progress_bar=False, enable_model_summary=False)
            if made.num_nodes > 1:
                raise UserError(
                    f"trainer.num_nodes={made.num_nodes} is not accepted; accepted: 1, with several devices"
                )

    @property
    def processes(self) -> int:
        """In how many processes the training runs, one for each device."""
        if not self.trainer:
            return 1
        return self.made_trainer(logger=False, enable_progress_bar=False, enable_model_summary=False).world_size

    def made_logger(self, folder: Path) -> Logger:
        """The logger of a run folder."""
        if self.logger == "csv":
            return CSVLogger(folder, name="csv", version="")
        if self.logger == "wandb":
            return WandbLogger(name=folder.name, save_dir=folder, project=self.project or "pcnclaws")
        return TensorBoardLogger(folder, name="tensorboard", version="")

    def made_callbacks(self) -> list[Callback]:
        """The callbacks of the logger, and those that not every run has."""
        dashboard = Dashboard(self.pictures)
        if self.patience is None:
            return [dashboard]
        return [dashboard, EarlyStopping("validation_mse", self.min_delta, self.patience, check_finite=False)]

    def made_trainer(self, **options: Any) -> Trainer:
        """The Trainer of these options and of the user's, which come first."""
        given = {
            name: value for name, value in self.trainer.items() if name != "strategy"
        }  # of several devices it is ddp
        try:
            return Trainer(**{**options, **given})
        except (MisconfigurationException, TypeError, ValueError) as fault:
            if not self.trainer:
                raise
            raise UserError(f"{self._given}: {' '.join(str(fault).split())}") from fault

    @property
    def _given(self) -> str:
        return ", ".join(f"trainer.{name}={value}" for name, value in self.trainer.items())
