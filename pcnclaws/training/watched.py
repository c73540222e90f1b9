"""Guard of every trained module: revert on non-finite gradients, and validation by whole rollouts."""

import logging
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

import torch
from lightning.pytorch import LightningModule
from torch import Tensor, nn

from pcnclaws.errors import SimulationDiverged
from pcnclaws.guards import count
from pcnclaws.simulation.motion import SceneSimulator
from pcnclaws.simulation.records import SceneRecord

log = logging.getLogger(__name__)

# So many iterations in a row without a finite gradient end a run.
MOST_SKIPPED = 20


class WatchedModule(LightningModule, ABC):
    """A module that trains a model in place.

    model          what is trained
    gradient_clip  largest norm of the gradient, None clips nothing
    step_back      an iteration without a finite gradient takes the weights halfway back to those of the last one that
                   had it, instead of leaving them: where all batches are alike, the next one would fail the same way
    """

    def __init__(self, gradient_clip: float | None, step_back: bool = False) -> None:
        super().__init__()
        self.gradient_clip, self.step_back = gradient_clip, step_back
        self.skipped = self.skipped_in_row = 0
        self._good: list[Tensor] = []

    @property
    @abstractmethod
    def model(self) -> SceneSimulator:
        """What is trained."""

    @abstractmethod
    def rollout_error(self, records: Sequence[SceneRecord]) -> float:
        """Mean position MSE [m^2] of whole rollouts of recorded scenes; infinite if one diverges."""

    def validation_step(self, batch: list[SceneRecord], batch_idx: int) -> None:
        """Logs the mean error of all scenes, of which each of several processes simulates its own."""
        share = batch[self.global_rank :: self.trainer.world_size]
        error = self.rollout_error(share) * (len(share) / len(batch)) if share else 0.0
        several = self.trainer.world_size > 1
        self.log("validation_mse", error, batch_size=1, sync_dist=several, reduce_fx="sum" if several else "mean")

    def on_before_optimizer_step(self, optimizer: torch.optim.Optimizer) -> None:
        """Watches the gradient: an iteration without a finite one leaves the optimiser as it is, see `step_back`."""
        gradients = [weight.grad for weight in self.parameters() if weight.grad is not None]
        norm = nn.utils.get_total_norm(gradients)
        self.log("gradient_norm", norm, batch_size=1)
        if bool(torch.isfinite(norm)):
            self.skipped_in_row = 0
            self._good = [weight.detach().clone() for weight in self.parameters()] if self.step_back else []
            return
        optimizer.zero_grad(set_to_none=True)
        for weight, good in zip(self.parameters(), self._good, strict=False):
            weight.data.lerp_(good.to(weight.device), 0.5)
        count("iterations_without_gradient")
        self.skipped, self.skipped_in_row = self.skipped + 1, self.skipped_in_row + 1
        log.warning(
            "iteration %d skipped: its gradient is not finite (%d skipped so far)",
            self.trainer.global_step,
            self.skipped,
        )
        if self.skipped_in_row >= MOST_SKIPPED:
            raise SimulationDiverged(
                f"training diverged: no finite gradient in {MOST_SKIPPED} iterations in a row up to iteration "
                f"{self.trainer.global_step}; lower training.learning_rate or shorten training.segment_length"
            )

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        checkpoint["skipped"] = [self.skipped, self.skipped_in_row]
        checkpoint["good_weights"] = [weight.cpu() for weight in self._good]

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        self.skipped, self.skipped_in_row = checkpoint["skipped"]
        self._good = list(checkpoint.get("good_weights", []))
