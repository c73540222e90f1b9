"""Impulses of colliders, summed over the steps of a run."""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor


class ImpulseSum:
    """What each collider has given to each scene since the start.

    numbers  the scenes of the batch that run now: of whom the impulses are that are taken
    total    [N s], (scenes, colliders, 3), double precision
    """

    def __init__(self, scenes: int, colliders: int) -> None:
        self.numbers: Sequence[int] = range(scenes)
        self.total: Float[Tensor, "scenes colliders 3"] = torch.zeros(scenes, colliders, 3, dtype=torch.float64)

    @torch.no_grad()
    def take(self, impulses: Float[Tensor, "colliders running 3"]) -> None:
        """Adds the impulses of one step."""
        self.total[list(self.numbers)] += impulses.transpose(0, 1).to(self.total)
