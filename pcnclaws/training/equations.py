"""Linear equations for the weights of networks, far fewer than weights: their most likely solution, kept up to date."""

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

# Standard deviation of what training changes in a weight.
PRIOR = 0.1
# Equations that are remembered, the latest ones, and numbers in them: 120 MB with the networks of model=pcnclaws.
MOST, MOST_NUMBERS = 1600, 20_000_000


class Equations:
    """Measurements of weights, g_i . (w - w_i) = -e_i with variances v_i, and a normal distribution known before.

        w = w_0 + PRIOR^2 G^T (PRIOR^2 G G^T + V)^-1 (g_i . (w_i - w_0) - e_i)_i

    is their mean after all of them, as a Kalman filter finds it one by one: in the space of equations, since a matrix
    of all pairs of weights would not fit into memory. In double precision.

    start  weights w_0 that are expected before any equation, (weights,)
    """

    def __init__(self, start: Float[Tensor, " weights"]) -> None:
        self.start, self.precision = start.double(), start.dtype
        # rows beyond len(self) are room for more: one product with all gradients is faster than many with a few
        self._rows = self.start.new_empty(0, len(self.start))
        self._products = self.start.new_empty(0, 0)
        self._wanted = self._variances = self.start.new_empty(0)

    def __len__(self) -> int:
        return len(self._wanted)

    def add(
        self,
        gradients: Sequence[Float[Tensor, " weights"]],
        weights: Float[Tensor, " weights"],
        errors: Sequence[float],
        variances: Sequence[float],
    ) -> None:
        """Further equations, all linearised at the same weights w_i; of too many, the oldest are forgotten."""
        if not gradients:
            return
        block = torch.stack([*gradients]).double()
        self._to(block.device)
        self._make_room(len(block))
        before, count = len(self), len(self) + len(block)
        self._rows[before:count] = block
        self._wanted = torch.cat((self._wanted, block @ (weights.double() - self.start) - block.new_tensor(errors)))
        self._variances = torch.cat((self._variances, block.new_tensor(variances)))
        beside = block @ self._rows[:count].T
        products = block.new_empty(count, count)
        products[:before, :before], products[before:], products[:, before:] = self._products, beside, beside.T
        self._products = products

    def solution(self) -> Float[Tensor, " weights"]:
        """The most likely weights, in double precision."""
        if not len(self):
            return self.start
        factor = torch.linalg.cholesky(PRIOR**2 * self._products + torch.diag(self._variances))
        amounts = torch.cholesky_solve(self._wanted[:, None], factor)[:, 0]
        return self.start + PRIOR**2 * (amounts @ self._rows[: len(self)])

    def state_dict(self) -> dict[str, Any]:
        """What a run that goes on needs, as plain tensors: gradients in the precision that they came in."""
        return {
            "start": self.start,
            "gradients": self._rows[: len(self)].to(self.precision),
            "products": self._products,
            "wanted": self._wanted,
            "variances": self._variances,
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Takes what state_dict gave."""
        self.start, self._products = state["start"].clone(), state["products"].clone()
        self._rows = state["gradients"].double()
        self._wanted, self._variances = state["wanted"].clone(), state["variances"].clone()

    def _make_room(self, more: int) -> None:
        """Forgets the oldest equations of too many, and doubles the room where there is none for `more`."""
        most = min(MOST, MOST_NUMBERS // len(self.start))
        gone = max(len(self) + more - most, 0)
        kept = self._rows[gone : len(self)]
        if gone or len(self) + more > len(self._rows):
            room = max(min(2 * len(kept), most), len(kept) + more)
            rows = self._rows.new_empty(room, len(self.start))
            rows[: len(kept)] = kept
            self._rows = rows
        self._products = self._products[gone:, gone:]
        self._wanted, self._variances = self._wanted[gone:], self._variances[gone:]

    def _to(self, device: torch.device) -> None:
        """Goes where the weights are."""
        self.start, self._products, self._rows = (one.to(device) for one in (self.start, self._products, self._rows))
        self._wanted, self._variances = self._wanted.to(device), self._variances.to(device)
