"""Levenberg-Marquardt for the amounts of a law, from whole motions: a few steps instead of many of Adam."""

import math
from collections.abc import Sequence
from typing import Protocol, cast, runtime_checkable

import torch
from torch import Tensor, nn

from pcnclaws.data.dataset import SegmentBatch
from pcnclaws.errors import SimulationDiverged, UserError
from pcnclaws.laws.analytic import Laws
from pcnclaws.laws.networks import ConditionedAmounts
from pcnclaws.simulation.rollout import differentiable_rollout
from pcnclaws.simulation.simulator import Simulator
from pcnclaws.training.gauss_newton import ROUNDING, GaussNewtonModule
from pcnclaws.training.losses import position_loss

# How far a step goes at most in any weight; damping at the start, and the least one.
FARTHEST, FIRST_DAMPING, LEAST_DAMPING = 0.1, 1e-2, 1e-6
# What a step that lowers the misfit makes of the damping, and one that does not; so many are tried.
TAKEN, FAILED, TRIES = 0.2, 8.0, 3
# Of an amount, for derivatives.
DIFFERENCE = 1e-7
# What keeps amounts that no segment shows: a share of the mean of the diagonal, and of the unit.
SHARE_OF_MEAN, RIDGE = 1e-3, 1e-3


class LevenbergMarquardtModule(GaussNewtonModule):
    """Damped least squares of the amounts of the plastic law, or of a purely elastic one, each step from its own batch.

        (A + d (diag A + SHARE_OF_MEAN mean(diag A)) + RIDGE I) dw = - g - RIDGE w
        A = sum_s f_s J_s^T J_s,   g = sum_s f_s J_s^T r_s

    with residuals r_s, derivatives J_s and factors f_s as in GaussNewtonModule. A step is taken if it lowers the
    misfit, sum_s log(|r_s|^2 + ROUNDING) + RIDGE |w|^2, whose gradient has these factors; otherwise the damping d
    grows. No weight moves further than FARTHEST. Before it, the law's own alternatives are tried: bounds that no body
    reaches have no gradient, and are found by jumps. The elastic law beside a plastic one stays what it was.

    source  Marquardt 1963, "An algorithm for least-squares estimation of nonlinear parameters"
    """

    damping: Tensor

    def __init__(self, laws: Laws, *arguments: object, **options: object) -> None:
        super().__init__(laws, *arguments, **options)
        self.register_buffer("damping", torch.tensor(FIRST_DAMPING, dtype=torch.float64))

    @staticmethod
    def check(laws: Laws) -> None:
        if not isinstance(getattr(_found(laws), "amounts", None), ConditionedAmounts):
            raise UserError(
                "training.method=levenberg_marquardt needs a law with amounts; accepted: model=pcnclaws_convex with a "
                "material that flows, model=pcnclaws_energy with a purely elastic one, or training.method=adam"
            )

    @property
    def _amounts(self) -> ConditionedAmounts:
        return cast(ConditionedAmounts, _found(self.laws).amounts)

    def training_step(self, batch: SegmentBatch, batch_idx: int) -> Tensor:
        """A loss whose gradient is the way to the new weights, backwards, as in GaussNewtonModule."""
        weight = self._amounts.weight
        now = weight.detach().clone()
        position = self._positions_with(batch, now)
        self.log("loss", position_loss(position, batch.target), batch_size=1)
        self.log("segment_length", float(batch.steps), batch_size=1)
        start = self._jumped(batch, now, position)
        if not math.isfinite(self._misfit(batch, *start)):
            return torch.nan * weight.sum()  # a diverged segment: the iteration is skipped
        return ((now - self._stepped(batch, *start)) * weight).sum()

    def _jumped(self, batch: SegmentBatch, now: Tensor, position: Tensor) -> tuple[Tensor, Tensor]:
        """The weights with the least misfit among these and the law's alternatives to them, and their positions."""
        law = _found(self.laws)
        others = law.alternatives() if isinstance(law, _HasAlternatives) else ()
        candidates = [(now, position), *((other, self._positions_with(batch, other)) for other in others)]
        return min(candidates, key=lambda candidate: self._misfit(batch, *candidate))

    def _stepped(self, batch: SegmentBatch, now: Tensor, position: Tensor) -> Tensor:
        """The weights after the first of some steps, each shorter than the one before, that lowers the misfit."""
        residual, derivatives = self._relative(batch, position, self._derivatives(batch, now, position))
        information, gradient = self._normal_equations(batch, residual, derivatives)
        misfit = self._misfit(batch, now, position)
        for _ in range(TRIES if bool(torch.isfinite(information).all()) else 0):
            there = now + self._damped_step(information, gradient + RIDGE * now.flatten()).view_as(now)
            lower = self._misfit(batch, there, self._positions_with(batch, there)) < misfit
            self.damping = (self.damping * (TAKEN if lower else FAILED)).clamp_min(LEAST_DAMPING)
            if lower:
                return there
        return now

    def _derivatives(self, batch: SegmentBatch, now: Tensor, position: Tensor) -> Tensor:
        """Of the positions by the amounts, (amounts, frames, 3, particles), as differences: in double precision they
        have digits enough, and cost two fifths of tangents."""
        columns = []
        for k in range(len(now)):
            beside = now.clone()
            beside[k, 0] += DIFFERENCE
            columns.append((self._positions_with(batch, beside) - position) / DIFFERENCE)
        return torch.stack(columns)

    def _positions_with(self, batch: SegmentBatch, weights: Tensor) -> Tensor:
        """Positions with other weights, which are put back afterwards; not numbers where a motion diverges."""
        weight = self._amounts.weight
        before = weight.detach().clone()
        simulator = cast(Simulator, self.simulators[batch.group]).starting_at(batch.start_time)
        try:
            with torch.no_grad():
                weight.copy_(weights)
                return differentiable_rollout(simulator, batch.start, batch.steps, batch.every, recompute=False)
        except SimulationDiverged:
            return torch.full_like(batch.target, torch.nan)
        finally:
            with torch.no_grad():
                weight.copy_(before)

    def _damped_step(self, information: Tensor, gradient: Tensor) -> Tensor:
        """The step, which moves no weight too far: some have far to go, and must not hold up all others."""
        diagonal = information.diagonal()
        held = self.damping * (diagonal + SHARE_OF_MEAN * diagonal.mean()) + RIDGE
        return torch.linalg.solve(information + torch.diag(held), -gradient).clamp(-FARTHEST, FARTHEST)

    def _misfit(self, batch: SegmentBatch, weights: Tensor, position: Tensor) -> float:
        """sum_s log(|r_s|^2 + ROUNDING) + RIDGE |w|^2, infinite where a motion diverges."""
        scenes = batch.start.scenes
        residual, _ = self._relative(batch, position, position[None])
        squared = residual.new_zeros(scenes.scene_count).index_add(0, scenes.scene_index, residual.square().sum((0, 1)))
        found = float((squared + ROUNDING).log().sum() + RIDGE * weights.square().sum())
        return found if math.isfinite(found) else math.inf


@runtime_checkable
class _HasAlternatives(Protocol):
    """A law that knows other weights of its amounts that are worth a try."""

    def alternatives(self) -> Sequence[Tensor]: ...


def _found(laws: Laws) -> nn.Module:
    """The law that is found: the plastic one, where there is one."""
    return laws.elasticity if laws.plasticity is None else laws.plasticity
