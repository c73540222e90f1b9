"""Levenberg-Marquardt for the amounts of a plastic law, from whole motions: a few steps instead of many of Adam."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import cast

import torch
from torch import Tensor

from pcnclaws.data.dataset import SegmentBatch
from pcnclaws.errors import SimulationDiverged, UserError
from pcnclaws.laws.analytic import Laws
from pcnclaws.laws.networks import ConditionedAmounts
from pcnclaws.simulation.rollout import differentiable_rollout
from pcnclaws.simulation.simulator import Simulator
from pcnclaws.training.gauss_newton import ROUNDING, GaussNewtonModule
from pcnclaws.training.losses import position_loss

# How far a step goes at most in any weight; damping at the start, and the least one.
FARTHEST, FIRST_DAMPING, LEAST_DAMPING = 0.1, 1e-2, 1e-5
# What a step makes of the damping that leaves so much of the misfit, at most; one that adds to it has gone too far.
GOOD, FAIR, FAILED = (0.5, 0.2), (1.0, 1.0), 8.0
# Steps that are tried from one linearisation.
STEPS = 8
# Of an amount, for derivatives.
DIFFERENCE = 1e-7
# What keeps amounts that no segment shows: a share of the mean of the diagonal, and of the unit.
SHARE_OF_MEAN, RIDGE = 1e-3, 3e-3


class LevenbergMarquardtModule(GaussNewtonModule):
    """Damped least squares of the plastic law's amounts, each step from its own batch.

        (A + d (diag A + SHARE_OF_MEAN mean(diag A)) + RIDGE I) dw = - g - RIDGE w
        A = sum_s f_s J_s^T J_s,   g = sum_s f_s J_s^T r_s

    with residuals r_s and derivatives J_s as in GaussNewtonModule, and f_s = 1/sqrt(|r_s|^2 + ROUNDING). A step is
    taken if it lowers sum_s sqrt(|r_s|^2 + ROUNDING) + RIDGE |w|^2/2, whose gradient has these factors: with squares a
    segment that is crushed decides alone, with logarithms one that fits already lets no other move. Otherwise the
    damping d grows. No weight moves further than FARTHEST. The elastic law stays what it was.

    source  Marquardt 1963, "An algorithm for least-squares estimation of nonlinear parameters"
    """

    damping: Tensor

    def __init__(self, laws: Laws, *arguments: object, **options: object) -> None:
        super().__init__(laws, *arguments, **options)
        self.register_buffer("damping", torch.tensor(FIRST_DAMPING, dtype=torch.float64))

    @staticmethod
    def check(laws: Laws) -> None:
        if not isinstance(getattr(laws.plasticity, "amounts", None), ConditionedAmounts):
            raise UserError(
                "training.method=levenberg_marquardt needs a plastic law with amounts; accepted: model=pcnclaws_convex "
                "with a material that flows, or training.method=adam"
            )

    @property
    def _amounts(self) -> ConditionedAmounts:
        return cast(ConditionedAmounts, getattr(self.laws.plasticity, "amounts"))  # noqa: B009

    def training_step(self, batch: SegmentBatch, batch_idx: int) -> Tensor:
        """A loss whose gradient is the way to the new weights, backwards, as in GaussNewtonModule."""
        weight = self._amounts.weight
        predicted, derivatives = self._linearised(batch)
        self.log("loss", position_loss(predicted, batch.target), batch_size=1)
        self.log("segment_length", float(batch.steps), batch_size=1)
        residual, derivatives = self._relative(batch, predicted, derivatives)
        if not bool(torch.isfinite(residual).all() & torch.isfinite(derivatives).all()):
            return torch.nan * weight.sum()  # a diverged segment: the iteration is skipped
        now = weight.detach().clone()
        return ((now - self._best(batch, now, residual, derivatives)) * weight).sum()

    def _best(self, batch: SegmentBatch, now: Tensor, residual: Tensor, derivatives: Tensor) -> Tensor:
        """The weights after some steps from one linearisation, which each step corrects."""
        error = self._misfit(batch, residual, now)
        self.damping = self.damping.clamp_max(FIRST_DAMPING)
        for _ in range(STEPS):
            information, gradient = self._normal_equations(batch, residual, derivatives)
            step = self._damped_step(information, gradient + RIDGE * now.flatten()).view_as(now)
            there = self._residual_at(batch, now + step)
            left = self._misfit(batch, there, now + step) / error
            self.damping = (self.damping * _change_of_damping(left)).clamp_min(LEAST_DAMPING)
            if bool(torch.isfinite(there).all()):
                self._correct(batch, derivatives, step, there - residual)
            if left < 1.0:
                now, residual, error = now + step, there, left * error
        return now

    def _correct(self, batch: SegmentBatch, derivatives: Tensor, step: Tensor, change: Tensor) -> None:
        """Broyden's update, in place: derivatives of each segment that say what the step has changed there.

        source  Broyden 1965, "A class of methods for solving nonlinear simultaneous equations"
        """
        of_amounts = (step @ self._amounts.features(batch.start.parameters).to(step))[:, None, None]
        missed = change - (of_amounts * derivatives).sum(0)
        derivatives += of_amounts * missed / of_amounts.square().sum(0).clamp_min(1e-30)

    def _linearised(self, batch: SegmentBatch) -> tuple[Tensor, Tensor]:
        """Positions, and their derivatives by the amounts, as differences: in double precision they have digits enough,
        and cost two fifths of tangents."""
        weight = self._amounts.weight
        now = weight.detach().clone()
        here, columns = self._rollout(batch, now), []
        for k in range(len(now)):
            beside = now.clone()
            beside[k, 0] += DIFFERENCE
            columns.append((self._rollout(batch, beside) - here) / DIFFERENCE)
        return here, torch.stack(columns)

    def _rollout(self, batch: SegmentBatch, weights: Tensor) -> Tensor:
        """Positions with other weights, which are put back afterwards."""
        weight = self._amounts.weight
        before = weight.detach().clone()
        simulator = cast(Simulator, self.simulators[batch.group]).starting_at(batch.start_time)
        try:
            with torch.no_grad():
                weight.copy_(weights)
                return differentiable_rollout(simulator, batch.start, batch.steps, batch.every, recompute=False)
        finally:
            with torch.no_grad():
                weight.copy_(before)

    def _damped_step(self, information: Tensor, gradient: Tensor) -> Tensor:
        """The step, which moves no weight too far: some have far to go, and must not hold up all others."""
        diagonal = information.diagonal()
        held = self.damping * (diagonal + SHARE_OF_MEAN * diagonal.mean()) + RIDGE
        return torch.linalg.solve(information + torch.diag(held), -gradient).clamp(-FARTHEST, FARTHEST)

    def _residual_at(self, batch: SegmentBatch, weights: Tensor) -> Tensor:
        """The residuals with other weights, not numbers where the motion diverges."""
        try:
            predicted = self._rollout(batch, weights)
        except SimulationDiverged:
            return torch.full_like(batch.target, torch.nan)
        return self._relative(batch, predicted, predicted[None])[0]

    def _misfit(self, batch: SegmentBatch, residual: Tensor, weights: Tensor) -> float:
        """sum_s sqrt(|r_s|^2 + ROUNDING) + RIDGE |w|^2/2."""
        scenes = batch.start.scenes
        squared = residual.new_zeros(scenes.scene_count).index_add(0, scenes.scene_index, residual.square().sum((0, 1)))
        found = float((squared + ROUNDING).sqrt().sum() + 0.5 * RIDGE * weights.square().sum())
        return found if math.isfinite(found) else math.inf

    @staticmethod
    def _factor(squared: Tensor) -> Tensor:
        return (squared + ROUNDING).rsqrt()

    @contextmanager
    def _unbounded(self) -> Iterator[None]:
        """Nothing: what bounds the plastic amounts is smooth."""
        yield


def _change_of_damping(left: float) -> float:
    return next((factor for most, factor in (GOOD, FAIR) if left <= most), FAILED)
