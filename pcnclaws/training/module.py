"""Lightning module that both regimes share: rollout, loss, optimiser, and validation by a full rollout."""

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import torch
from torch import Tensor, nn
from torch.optim.lr_scheduler import CosineAnnealingLR

from pcnclaws.data.dataset import SegmentBatch
from pcnclaws.errors import UserError, unknown_name
from pcnclaws.laws.analytic import Laws
from pcnclaws.metrics import Positions
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.simulation.execution import Execution
from pcnclaws.simulation.fast_paths import Skips
from pcnclaws.simulation.law_simulator import LawSimulator
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.simulation.rollout import differentiable_rollout
from pcnclaws.simulation.scenes import start_of
from pcnclaws.simulation.simulator import Simulator, simulator_of
from pcnclaws.training.losses import position_loss, relative_errors, unstressed_positions
from pcnclaws.training.processes import gathered
from pcnclaws.training.scene_errors import SceneErrors
from pcnclaws.training.schedule import cosine_schedule, lengthen
from pcnclaws.training.watched import WatchedModule

# The optimiser sees the loss times this, meant to keep gradients above its epsilon of 1e-8: squared metres are tiny
# numbers, relative errors small ones.
LOSS_SCALE = {"relative": 1e4, "robust": 1e4, "absolute": 1e8}


@dataclass(frozen=True)
class OptimiserSettings:
    """Adam with cosine annealing, one step of the schedule an iteration, and the loss that it minimises.

    learning_rate          at the first iteration
    final_learning_rate    at the last one
    gradient_clip          largest norm of the gradient of the scaled loss; None clips nothing
    recompute              save memory by computing each step twice; None decides by the size of the batch
    loss                   'relative': mean of relative_errors; 'robust': the same, scenes that contradict the others
                           counting less (SceneErrors); 'absolute': position_loss, the paper's
    loss_scale             what the loss is multiplied with; None is LOSS_SCALE
    step_back              see WatchedModule
    plastic_learning_rate  of the plastic law, whose gradient is then clipped by itself; None is that of the elastic one
    """

    learning_rate: float = 3e-3
    final_learning_rate: float = 0.0
    gradient_clip: float | None = None
    recompute: bool | None = None
    loss: str = "relative"
    loss_scale: float | None = None
    plastic_learning_rate: float | None = None
    step_back: bool = False

    def __post_init__(self) -> None:
        if self.loss not in LOSS_SCALE:
            raise unknown_name("training.loss", self.loss, LOSS_SCALE)
        for option in ("learning_rate", "plastic_learning_rate", "loss_scale"):
            value = getattr(self, option)
            if value is not None and not (math.isfinite(value) and value > 0.0):
                raise UserError(f"training.{option}={value} is not accepted; accepted: a positive number")
        if not 0.0 <= self.final_learning_rate <= self.learning_rate:
            raise UserError(
                f"training.final_learning_rate={self.final_learning_rate} is not accepted; "
                f"accepted: 0 to training.learning_rate={self.learning_rate:g}"
            )
        if self.gradient_clip is not None and not self.gradient_clip > 0.0:
            raise UserError(
                f"training.gradient_clip={self.gradient_clip} is not accepted; "
                "accepted: a positive number, or null for none"
            )

    @property
    def scale(self) -> float:
        """What the loss is multiplied with."""
        return LOSS_SCALE[self.loss] if self.loss_scale is None else self.loss_scale


class ConstitutiveModule(WatchedModule):
    """Trains the laws of a material by differentiating through the simulation.

    laws        neural laws, trained in place
    settings    the simulation settings that the batches' group numbers stand for
    optimiser   see OptimiserSettings
    iterations  length of the learning-rate schedule
    skips       what the simulations leave out, everything that they can by default
    """

    def __init__(
        self,
        laws: Laws,
        settings: Sequence[SimulationSettings],
        optimiser: OptimiserSettings,
        iterations: int,
        skips: Skips | None = None,
    ) -> None:
        super().__init__(optimiser.gradient_clip, optimiser.step_back)
        self.laws, self.skips = laws, skips or Skips()
        self.simulators = nn.ModuleList(simulator_of(laws, setting, self.skips) for setting in settings)
        self.settings, self.iterations = optimiser, iterations
        self.scene_errors = SceneErrors()

    @property
    def model(self) -> LawSimulator:
        return LawSimulator(self.laws)

    @staticmethod
    @abstractmethod
    def choose_scenes(records: Sequence[SceneRecord], scene: str | int | None) -> list[SceneRecord]:
        """The scenes that the regime trains on; `scene` is the option regime.scene."""

    def training_step(self, batch: SegmentBatch, batch_idx: int) -> Tensor:
        simulator = cast(Simulator, self.simulators[batch.group]).starting_at(batch.start_time)
        predicted = differentiable_rollout(
            simulator, batch.start, batch.steps, batch.every, recompute=self.settings.recompute, skips=self.skips
        )
        error = position_loss(predicted, batch.target)
        self.log("loss", error.detach() * batch.share.observations, batch_size=1, sync_dist=self.trainer.world_size > 1)
        self.log("segment_length", float(batch.steps), batch_size=1)
        self.log("learning_rate", self.trainer.optimizers[0].param_groups[0]["lr"], batch_size=1)
        loss = self.settings.scale * self._loss(batch, simulator, predicted, error)
        return loss if self.trainer.world_size == 1 else loss + self._nothing()

    def _nothing(self) -> Tensor:
        """Zero, with a gradient of zero for every weight: other processes wait for each, also from free flight."""
        return 0.0 * torch.stack([weight.sum() for weight in self.parameters() if weight.requires_grad]).sum()

    def _loss(self, batch: SegmentBatch, simulator: Simulator, predicted: Tensor, error: Tensor) -> Tensor:
        """What is minimised: the squared error [m^2], or each segment's relative to its motion [-]."""
        if self.settings.loss == "absolute":
            return error * batch.share.observations
        times = range(batch.every, batch.steps + 1, batch.every)
        time_step = simulator.integrator.settings.time_step
        state, scenes = batch.start.state, batch.start.scenes
        unstressed = unstressed_positions(state, scenes, time_step, times)
        segments, names = (scenes.scene_index, scenes.scene_count), batch.start.names
        errors = relative_errors(predicted, batch.target, unstressed, *segments)
        weights = self.scene_errors.weights(names) if self.settings.loss == "robust" else None
        told = list(zip(names, errors.tolist(), strict=True)) if batch.share.segments else []
        for name, of_scene in gathered(told, self.trainer.world_size):
            self.scene_errors.note([name], [of_scene])
        loss = errors.mean() if weights is None else (errors.new_tensor(weights) * errors).mean()
        return loss * batch.share.segments

    @property
    def networks(self) -> Mapping[str, nn.Module]:
        laws = zip(self.laws._fields, self.laws, strict=True)
        return {name: law for name, law in laws if law is not None and any(True for _ in law.parameters())}

    def predicted(self, records: Sequence[SceneRecord]) -> list[Positions]:
        weight = next(self.parameters())
        steps = [record.frame_steps() for record in records]
        every = math.gcd(*(int(step) for of_scene in steps for step in of_scene))
        rollouts = simulate_records(
            [start_of(record) for record in records],
            self.laws,
            FramePlan(max(int(of_scene[-1]) for of_scene in steps), every),
            Execution(weight.dtype, weight.device, self.skips),
        )
        return [rollout.position[of_scene // every] for rollout, of_scene in zip(rollouts, steps, strict=True)]

    def configure_optimizers(self) -> Any:
        optimiser = torch.optim.Adam(self._parameter_groups(), lr=self.settings.learning_rate)
        schedule = cosine_schedule(optimiser, self.iterations, self.settings.final_learning_rate)
        return {"optimizer": optimiser, "lr_scheduler": {"scheduler": schedule, "interval": "step"}}

    def contradicting(self) -> dict[str, float]:
        return self.scene_errors.contradicting()

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        super().on_save_checkpoint(checkpoint)
        checkpoint["scene_errors"] = self.scene_errors.state_dict()

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        super().on_load_checkpoint(checkpoint)
        self.scene_errors.load_state_dict(checkpoint.get("scene_errors", {}))

    def on_train_start(self) -> None:
        """A run that goes on for longer follows the schedule of its whole length."""
        schedule = self.lr_schedulers()
        if isinstance(schedule, CosineAnnealingLR):
            lengthen(schedule, self.iterations)

    def configure_gradient_clipping(
        self,
        optimizer: torch.optim.Optimizer,
        gradient_clip_val: float | None = None,
        gradient_clip_algorithm: str | None = None,
    ) -> None:
        """Clips the gradient, of each law by itself where they have learning rates of their own."""
        if gradient_clip_val is not None:
            for group in optimizer.param_groups:
                nn.utils.clip_grad_norm_(group["params"], gradient_clip_val)

    def _parameter_groups(self) -> list[dict[str, Any]]:
        """The weights with their learning rates: all together, or those of each law."""
        if self.settings.plastic_learning_rate is None or self.laws.plasticity is None:
            return [{"params": list(self.parameters())}]
        plastic = {"params": list(self.laws.plasticity.parameters()), "lr": self.settings.plastic_learning_rate}
        return [{"params": list(self.laws.elasticity.parameters())}, plastic]
