"""Walls of the box domain, applied to grid velocities."""

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from pcnclaws.mpm.grid import Grid
from pcnclaws.mpm.settings import DISTANCE_TOLERANCE


def wall_nodes(grid: Grid, wall_distance: float) -> Bool[Tensor, "2 3 nodes"]:
    """Which nodes of one scene belong to a wall: [0] walls at the low sides, [1] at the high sides, by axis.

    A wall acts on every node at most `wall_distance` [m] from a side, and on the padding beyond the side.
    """
    sides = _sides(grid, wall_distance)
    shape = (2, grid.edge, grid.edge, grid.edge)
    by_axis = (
        sides[:, :, None, None].expand(shape),
        sides[:, None, :, None].expand(shape),
        sides[:, None, None, :].expand(shape),
    )
    return torch.stack(by_axis, dim=1).flatten(2)


def axis_walls(grid: Grid, wall_distance: float) -> bytes:
    """What the nodes of an axis are: 1 in a wall at the low side, 2 at the high side, 3 in both, 0 in none."""
    low, high = _sides(grid, wall_distance)
    return bytes((low.long() + 2 * high.long()).tolist())


def apply_walls(
    velocity: Float[Tensor, "3 scenes nodes"], walls: Bool[Tensor, "2 3 nodes"], boundary: str
) -> Float[Tensor, "3 scenes nodes"]:
    """Grid velocity after contact [m/s].

    slip   removes the component that points into the wall
    stick  removes the whole velocity of a node whose velocity points into a wall
    Both let go freely: a velocity that points away from the wall is untouched.
    """
    low, high = walls[:, :, None]
    into_wall = (low & (velocity < 0.0)) | (high & (velocity > 0.0))
    if boundary == "stick":
        into_wall = into_wall.any(0, keepdim=True)
    return torch.where(into_wall, 0.0, velocity)


def _sides(grid: Grid, wall_distance: float) -> Bool[Tensor, "2 edge"]:
    """Which nodes of an axis belong to the wall at its low side, [0], and at its high side, [1]."""
    coordinate = grid.coordinates()
    reach = wall_distance + DISTANCE_TOLERANCE * grid.spacing
    return torch.stack((coordinate <= reach, coordinate >= 1.0 - reach))
