"""The background grid: where its nodes lie and how they are numbered.

Grid node i of an axis lies at i dx. One layer of nodes beyond each side of the domain completes the
stencils of particles near a side, so that every position in [0, 1]^3 has its 27 nodes. The nodes of all
scenes of a batch are numbered one scene after the other.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

PADDING = 1


@dataclass(frozen=True)
class Grid:
    """A cubic grid over [0, 1]^3 m with `nodes` cells along an edge."""

    nodes: int

    @property
    def spacing(self) -> float:
        """dx [m]."""
        return 1.0 / self.nodes

    @property
    def edge(self) -> int:
        """Nodes along an edge, both sides of the domain and the padding included."""
        return self.nodes + 1 + 2 * PADDING

    @property
    def size(self) -> int:
        """Nodes of one scene."""
        return self.edge**3

    def coordinates(self, dtype: torch.dtype = torch.float64) -> Tensor:
        """Coordinates of the nodes of one axis [m], (edge,)."""
        return torch.arange(-PADDING, self.nodes + 1 + PADDING, dtype=dtype) * self.spacing

    def stencil_offsets(self) -> Tensor:
        """Node number of each of the 27 stencil nodes relative to the first one, x outermost, (27,)."""
        along = torch.arange(3)
        return ((along[:, None, None] * self.edge + along[None, :, None]) * self.edge + along[None, None, :]).flatten()
