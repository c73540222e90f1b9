"""Kalman filter for the weights of networks: what each segment has said about them is remembered, in place of Adam."""

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, cast

import torch
from jaxtyping import Float
from torch import Tensor

from pcnclaws.data.dataset import SegmentBatch
from pcnclaws.simulation.active_scenes import group_of
from pcnclaws.simulation.batch import SceneBatch
from pcnclaws.simulation.rollout import differentiable_rollout
from pcnclaws.simulation.simulator import Simulator
from pcnclaws.training.equations import Equations
from pcnclaws.training.losses import position_loss, relative_units, unstressed_positions
from pcnclaws.training.multi_scene import MultiSceneModule

# Squared error of a segment, relative to its motion by stress, that is the rounding of recorded states.
ROUNDING = 1e-7
# Smallest error of a segment that says anything.
SMALLEST = 1e-12


class KalmanModule(MultiSceneModule):
    """Extended Kalman filter whose state are the weights, each segment being one measurement of its error.

        g_s . (w - w_s) = -|r_s|,   variance |r_s|^2 + ROUNDING,   g_s = d|r_s|/dw at w_s

    with the residuals r_s of segment s, positions relative to its motion by stress, and the weights w_s when it came.
    At the true law every error vanishes, so that all segments are equations for the same weights, and the weights are
    their solution nearest to the ones at the start (Equations). A gradient a segment is needed, as Adam needs it, and
    nothing of it is forgotten. The variances are as in GaussNewtonModule: what was linearised near the law says more.

    source  Singhal and Wu 1988, "Training multilayer perceptrons with the extended Kalman algorithm", NIPS 1
    """

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.equations = Equations(self._weights())

    def training_step(self, batch: SegmentBatch, batch_idx: int) -> Tensor:
        """A loss whose gradient is the way to the new weights, backwards, as in GaussNewtonModule."""
        now, errors, losses, gradients, informative = self._weights(), [], [], [], []
        for segment in _segments(batch):
            error, loss = self._error(segment)
            gradient = self._gradient(error)
            errors.append(float(error.detach()))
            losses.append(float(loss))
            if bool(gradient.any()):  # free flight says nothing
                gradients.append(gradient)
                informative.append(errors[-1])
        squared = [error**2 for error in errors]
        self.scene_errors.note(batch.start.names, squared)
        self.log("loss", sum(losses) / len(losses), batch_size=1)
        self.log("segment_length", float(batch.steps), batch_size=1)
        if not _all_finite(gradients, errors):  # a diverged segment: the iteration is skipped
            return torch.nan * torch.stack([weight.sum() for weight in self.parameters()]).sum()
        self.equations.add(gradients, now, informative, [error**2 + ROUNDING for error in informative])
        return _descending(self.parameters(), now.double() - self.equations.solution().to(now.device))

    def configure_optimizers(self) -> torch.optim.Optimizer:
        return torch.optim.SGD(self.parameters(), lr=1.0)

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        super().on_save_checkpoint(checkpoint)
        checkpoint["equations"] = self.equations.state_dict()

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        super().on_load_checkpoint(checkpoint)
        self.equations.load_state_dict(checkpoint["equations"])

    def _weights(self) -> Float[Tensor, " weights"]:
        return torch.cat([weight.detach().flatten() for weight in self.parameters()])

    def _error(self, segment: SegmentBatch) -> tuple[Float[Tensor, ""], Float[Tensor, ""]]:
        """|r| of one segment, relative to its motion by stress [-], and its position loss [m^2]."""
        simulator = cast(Simulator, self.simulators[segment.group]).starting_at(segment.start_time)
        state, scenes = segment.start.state, segment.start.scenes
        predicted = differentiable_rollout(
            simulator,
            segment.start,
            segment.steps,
            segment.every,
            recompute=self.settings.recompute,
            skips=self.skips,
        )
        times = range(segment.every, segment.steps + 1, segment.every)
        unstressed = unstressed_positions(state, scenes, simulator.integrator.settings.time_step, times)
        units = relative_units(segment.target, unstressed, scenes.scene_index, scenes.scene_count)
        observed = ~torch.isnan(segment.target)
        residual = torch.where(observed, predicted - torch.where(observed, segment.target, 0.0), 0.0) * units
        loss = position_loss(predicted.detach(), segment.target)
        return residual.square().sum().clamp_min(SMALLEST**2).sqrt(), loss

    def _gradient(self, error: Float[Tensor, ""]) -> Float[Tensor, " weights"]:
        weights = [*self.parameters()]
        if not error.requires_grad:
            return torch.zeros_like(self._weights())
        parts = torch.autograd.grad(error, weights, allow_unused=True, materialize_grads=True)
        return torch.cat([part.flatten() for part in parts])


def _all_finite(gradients: Sequence[Tensor], errors: Sequence[float]) -> bool:
    return all(map(math.isfinite, errors)) and all(bool(torch.isfinite(one).all()) for one in gradients)


def _descending(weights: Iterable[Tensor], step: Float[Tensor, " weights"]) -> Float[Tensor, ""]:
    """A scalar whose gradient is the step."""
    several = [*weights]
    parts = step.split([weight.numel() for weight in several])
    pairs = zip(parts, several, strict=True)
    return torch.stack([(part.view_as(weight).to(weight.dtype) * weight).sum() for part, weight in pairs]).sum()


def _segments(batch: SegmentBatch) -> Iterator[SegmentBatch]:
    """The segments of a batch, each as a batch of its own."""
    start = batch.start
    for number in range(start.scenes.scene_count):
        one = group_of(start.scenes, start.parameters, [number])
        target = batch.target if one.particles is None else batch.target[..., one.particles]
        alone = SceneBatch(one.part_of(start.state), one.scenes, dict(one.parameters), start.names[number:][:1])
        yield batch._replace(start=alone, target=target)
