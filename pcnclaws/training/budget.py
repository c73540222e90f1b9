"""Wall-clock budget of a training."""

import math
import time
from typing import Any

from lightning.pytorch import LightningModule, Trainer
from lightning.pytorch.callbacks import Callback


class WallClock(Callback):
    """Ends a training at the first check after so many seconds of it, those before an interruption included.

    budget  [s], iterations and checks; None never ends it
    """

    def __init__(self, budget: float | None) -> None:
        self.budget = budget
        self._before = 0.0
        self._began: float | None = None

    @property
    def spent(self) -> float:
        """Seconds of training so far; what was lost to an interruption does not count."""
        return self._before + (0.0 if self._began is None else time.monotonic() - self._began)

    @property
    def share(self) -> float:
        """How much of the budget is spent, 0 without one."""
        return self.spent / self.budget if self.budget else 0.0

    @property
    def left(self) -> float:
        """Seconds that are left, infinite without a budget."""
        return max(self.budget - self.spent, 0.0) if self.budget else math.inf

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        self._began = time.monotonic()
        self._end_if_spent(trainer)

    def on_validation_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        self._end_if_spent(trainer)

    def on_train_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        self._before, self._began = self.spent, None

    def state_dict(self) -> dict[str, Any]:
        return {"seconds": self.spent}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        self._before = float(state_dict["seconds"])

    def _end_if_spent(self, trainer: Trainer) -> None:
        if trainer.strategy.broadcast(self.share >= 1.0):  # the clock of the first process counts
            trainer.should_stop = True
