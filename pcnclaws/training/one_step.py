"""One-step training of learned simulators: from recorded frames to the next one, no simulation between."""

import math
from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from pcnclaws.metrics import Positions
from pcnclaws.simulation.execution import Execution
from pcnclaws.simulation.motion import MotionModel
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.simulation.scenes import start_of
from pcnclaws.training.budget import WallClock
from pcnclaws.training.watched import WatchedModule

# The learning rate at the end over that at the start.
LAST_LEARNING_RATE = 0.01


class OneStepModule(WatchedModule):
    """Adam on the error of single steps; the learning rate falls exponentially by LAST_LEARNING_RATE in all.

    iterations  length of the training, if the clock does not end it before
    clock       see WallClock; the learning rate follows whichever is nearer to its end
    """

    def __init__(
        self,
        model: MotionModel,
        learning_rate: float,
        gradient_clip: float | None,
        iterations: int,
        clock: WallClock,
    ) -> None:
        super().__init__(gradient_clip)
        self.simulator, self.learning_rate = model, learning_rate
        self.iterations, self.clock = iterations, clock

    @property
    def model(self) -> MotionModel:
        return self.simulator

    def on_train_batch_start(self, batch: Any, batch_idx: int) -> None:
        progress = min(max(self.trainer.global_step / self.iterations, self.clock.share), 1.0)
        for group in self.trainer.optimizers[0].param_groups:
            group["lr"] = self.learning_rate * LAST_LEARNING_RATE**progress

    def training_step(self, batch: Any, batch_idx: int) -> Tensor:
        loss, squared_error = self.simulator.loss(batch)
        self.log("loss", squared_error.detach().float(), batch_size=1)
        self.log("learning_rate", self.trainer.optimizers[0].param_groups[0]["lr"], batch_size=1)
        return loss

    def predicted(self, records: Sequence[SceneRecord]) -> list[Positions]:
        return [self._rollout(record) for record in records]

    def configure_optimizers(self) -> torch.optim.Optimizer:
        return torch.optim.Adam(self.parameters(), lr=self.learning_rate)

    def _rollout(self, record: SceneRecord) -> Positions:
        steps = record.frame_steps()
        every = math.gcd(*(int(step) for step in steps))
        weight = next(self.parameters())
        plan, execution = FramePlan(int(steps[-1]), every), Execution(weight.dtype, weight.device)
        return self.simulator.simulate([start_of(record)], plan, execution)[0].position[steps // every]
