"""Averages of weights over the last part of a training: what Adam's noise adds to single ones cancels."""

from lightning.pytorch.callbacks import WeightAveraging
from torch import Tensor

from pcnclaws.errors import UserError


class AveragedWeights(WeightAveraging):
    """Checks, and what is kept of a run, are of weights averaged over the iterations so far, the latest counting most.

        mean_n = mean_{n-1} + (power + 1)/(n + power) (w_n - mean_{n-1})

    which is polynomial-decay averaging of O. Shamir and T. Zhang, "Stochastic gradient descent for non-smooth
    optimization", ICML 2013: it leaves the beginning behind by itself, as n^-power, whatever the length of the run.
    The optimiser goes on with its own weights.

    power   0 is the plain mean of all iterations; larger ones forget faster
    raises  UserError
    """

    def __init__(self, power: float) -> None:
        if not 0.0 <= power < float("inf"):
            raise UserError(f"training.average={power} is not accepted; accepted: a number from 0, or null for none")
        self.power = power
        super().__init__(use_buffers=False, avg_fn=self._towards)

    def _towards(self, mean: Tensor, now: Tensor, before: Tensor | int) -> Tensor:
        """The next mean; `before` iterations are in the last one, which itself holds the first."""
        number = float(before) + 1.0
        return mean + (self.power + 1.0) / (number + self.power) * (now - mean)
