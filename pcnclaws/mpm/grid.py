"""The background grid: where its nodes lie and how they are numbered.

Grid node i of an axis lies i dx from the lower corner of the domain (from 0 where there is none). A grid is a box of
such nodes, the same for all scenes of a batch: the whole domain, or where that is large the part that the particles
touch. One layer of nodes beyond each side of the domain completes the stencils of particles near a side, so that every
position in the domain has its 27 nodes. The nodes of all scenes of a batch are numbered one scene after the other.
"""

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from pcnclaws.errors import SimulationDiverged
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.tensors.tensor_types import Vectors

PADDING = 1
# A domain of at most so many nodes is stored whole.
MOST_WHOLE = 2**18
# What the particles of an unbounded or large domain touch may have so many nodes in each scene.
MOST_NODES = 2**26
FAR = 2**30  # nodes from the origin, more than any scene has

Node = tuple[int, int, int]


@dataclass(frozen=True)
class Grid:
    """A box of grid nodes.

    origin     place of node 0 [m]
    per_metre  cells in a metre, 1 / dx
    spacing    dx [m]
    low, high  first and last node along each axis
    """

    origin: tuple[float, float, float]
    per_metre: float
    spacing: float
    low: Node
    high: Node

    @property
    def edges(self) -> Node:
        """Nodes along each axis."""
        x, y, z = (high - low + 1 for low, high in zip(self.low, self.high, strict=True))
        return x, y, z

    @property
    def size(self) -> int:
        """Nodes of one scene."""
        x, y, z = self.edges
        return x * y * z

    def axis(self, axis: int, dtype: torch.dtype = torch.float64) -> Tensor:
        """Coordinates of the nodes of one axis [m], (edge,)."""
        return torch.arange(self.low[axis], self.high[axis] + 1, dtype=dtype) * self.spacing + self.origin[axis]

    def stencil_offsets(self) -> Tensor:
        """Node number of each of the 27 stencil nodes relative to the first one, x outermost, (27,)."""
        along, (_, y, z) = torch.arange(3), self.edges
        return ((along[:, None, None] * y + along[None, :, None]) * z + along[None, None, :]).flatten()

    def _extremes(self, position: Vectors) -> list[list[float]]:
        """First and last middle nodes of all particles that are somewhere, along each axis."""
        # rounding is monotone: the nodes of the extremes are the extremes of the nodes
        corners = torch.stack((position.amin(1), position.amax(1)), dim=1)
        # a list: under torch.func a tensor does not give away its memory
        ends = middle_nodes(corners, self).T.tolist()
        if _known(ends):
            return ends
        middle = middle_nodes(position, self)
        known = middle.isfinite() & (middle.abs() < FAR)
        first = torch.where(known, middle, float(FAR)).amin(1)
        last = torch.where(known, middle, -float(FAR)).amax(1)
        return torch.stack((first, last)).tolist()

    def window(self, position: Vectors) -> "Grid":
        """The part of the grid that particles touch.

        position  [m], (3, particles); those that are nowhere count for none
        raises    SimulationDiverged where they are so far apart that it could not be stored
        """
        ends = list(zip(*self._extremes(position.detach()), self.low, self.high, strict=True))
        x, y, z = (_within(int(first), low + 1, high - 1) for first, _, low, high in ends)
        lasts = (_within(int(last), low + 1, high - 1) for _, last, low, high in ends)
        u, v, w = (max(last, first) for first, last in zip((x, y, z), lasts, strict=True))
        window = replace(self, low=(x - 1, y - 1, z - 1), high=(u + 1, v + 1, w + 1))
        if window.size > MOST_NODES:
            raise SimulationDiverged(
                f"the particles are spread over {' x '.join(map(str, window.edges))} cells, more than can be stored; "
                "they flew apart, or the domain needs a larger simulation.grid_spacing"
            )
        return window


def _known(ends: list[list[float]]) -> bool:
    return all(abs(end) < FAR for axis in ends for end in axis)  # false for what is not a number


def middle_nodes(position: Vectors, grid: Grid) -> Vectors:
    """The number of the node in the middle of the stencil of each particle, wherever it is, as floating point."""
    origin = position.new_tensor(grid.origin)[:, None]
    return torch.floor((position - origin) * grid.per_metre + 0.5)


def grid_of(settings: SimulationSettings) -> Grid:
    """The whole grid of the domain, padding included."""
    if settings.domain is None or settings.cells is None:
        far = (FAR, FAR, FAR)
        return Grid((0.0, 0.0, 0.0), 1.0 / settings.grid_spacing, settings.grid_spacing, (-FAR, -FAR, -FAR), far)
    low, high = settings.domain
    x, y, z = settings.cells
    ends = (x + PADDING, y + PADDING, z + PADDING)
    return Grid(low, x / (high[0] - low[0]), settings.grid_spacing, (-PADDING, -PADDING, -PADDING), ends)


def _within(value: int, low: int, high: int) -> int:
    return min(max(value, low), high)
