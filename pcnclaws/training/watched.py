"""Guard of every trained module: revert on non-finite gradients, and validation by whole rollouts."""

import logging
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

import torch
from lightning.pytorch import LightningModule
from torch import Tensor, nn

from pcnclaws.errors import SimulationDiverged
from pcnclaws.guards import count
from pcnclaws.metrics import Positions
from pcnclaws.simulation.motion import SceneSimulator
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.training.checks import Check
from pcnclaws.training.processes import gathered

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
        self.check = Check((), ())  # the last one
        self._good: list[Tensor] = []

    @property
    @abstractmethod
    def model(self) -> SceneSimulator:
        """What is trained."""

    @property
    def networks(self) -> Mapping[str, nn.Module]:
        """The parts of the model whose gradients are watched one by one, by name."""
        return {}

    def contradicting(self) -> dict[str, float]:
        """Training scenes that are explained worse than the others by far, and how many times; none where unknown."""
        return {}

    @abstractmethod
    def predicted(self, records: Sequence[SceneRecord]) -> list[Positions]:
        """Whole rollouts of recorded scenes at the frames of each; SimulationDiverged if one diverges."""

    def checked(self, records: Sequence[SceneRecord]) -> Check:
        """The rollouts of recorded scenes beside the records."""
        try:
            return Check(tuple(records), tuple(self.predicted(records)))
        except SimulationDiverged as divergence:
            log.warning("check failed: %s", divergence)
            return Check(tuple(records), ())

    def _check_of_all(self, records: list[SceneRecord]) -> Check:
        """The check of all scenes, of which each of several processes simulates its own and is told the others'."""
        count = self.trainer.world_size
        if count == 1:
            return self.checked(records)
        own = records[self.global_rank :: count]
        predicted = gathered(self.checked(own).predicted if own else (), count)
        return Check(tuple(records), tuple(predicted) if len(predicted) == len(records) else ())  # one has diverged

    def validation_step(self, batch: list[SceneRecord], batch_idx: int) -> None:
        self.check = self._check_of_all(batch)
        several = self.trainer.world_size > 1  # all of which log the same
        self.log("validation_mse", self.check.mse, batch_size=1, sync_dist=several)
        for name, error in self.check.errors.items():
            self.log(f"validation/{name}", error, batch_size=1, sync_dist=several)

    def on_before_optimizer_step(self, optimizer: torch.optim.Optimizer) -> None:
        """Watches the gradient: an iteration without a finite one leaves the optimiser as it is, see `step_back`."""
        gradients = [weight.grad for weight in self.parameters() if weight.grad is not None]
        norm = nn.utils.get_total_norm(gradients)
        self.log("gradient_norm", norm, batch_size=1)
        for name, network in self.networks.items():
            of_one = [weight.grad for weight in network.parameters() if weight.grad is not None]
            self.log(f"gradient_norm/{name}", nn.utils.get_total_norm(of_one), batch_size=1)
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
