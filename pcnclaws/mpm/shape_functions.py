"""Quadratic B-spline weights of the 27 grid nodes around each particle."""

from typing import NamedTuple

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from pcnclaws.mpm.grid import Grid, middle_nodes
from pcnclaws.tensors.tensor_types import SceneIndex, Vectors


class Stencil(NamedTuple):
    """The grid nodes that a particle exchanges with. Offset-major: the 27 nodes first, the particles last.

    node        number of each node in the grids of the batch, (27, particles)
    weight      B-spline weight of each node [-], (27, particles), sums to 1 over the nodes
    from_middle particle position relative to the middle node of its stencil, in units of dx, (3, particles),
                in [-1/2, 1/2]
    """

    node: Int64[Tensor, "27 particles"]
    weight: Float[Tensor, "27 particles"]
    from_middle: Vectors


def quadratic_stencil(position: Vectors, scene_index: SceneIndex, grid: Grid, offsets: Tensor) -> Stencil:
    """Nodes and quadratic B-spline weights of each particle.

    With d the distance to the middle node in units of dx: w = (1/2 (1/2 - d)^2, 3/4 - d^2, 1/2 (1/2 + d)^2).
    Positions outside the grid (a diverged particle, which the rollout reports) borrow the nearest stencil
    so that memory is never touched out of bounds.

    position     [m], (3, particles)
    scene_index  (particles,)
    offsets      Grid.stencil_offsets() on the device of the particles, (27,)
    source       Jiang et al. 2016, "The material point method for simulating continuum materials", eq. 123
    """
    origin, low, high = (position.new_tensor(corner)[:, None] for corner in (grid.origin, grid.low, grid.high))
    middle = middle_nodes(position.detach(), grid).nan_to_num(0.0).clamp(low + 1.0, high - 1.0)
    d = (position - origin) * grid.per_metre - middle
    axis_weight = torch.stack((0.5 * (0.5 - d).square(), 0.75 - d.square(), 0.5 * (0.5 + d).square()), dim=1)
    x, y, z = axis_weight
    weight = ((x[:, None] * y[None]).unsqueeze(2) * z[None, None]).flatten(0, 2)

    first = (middle - low).long() - 1
    number = (first[0] * grid.edges[1] + first[1]) * grid.edges[2] + first[2] + scene_index * grid.size
    return Stencil(number + offsets[:, None], weight, d)
