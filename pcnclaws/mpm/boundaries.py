"""Boundaries: operators on grid velocities, the walls of the domain and the colliders in the order of their list."""

import math
from collections.abc import Sequence
from functools import lru_cache

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from pcnclaws.mpm.colliders import Collider, NodesInside
from pcnclaws.mpm.contact import velocity_after_contact
from pcnclaws.mpm.grid import Grid
from pcnclaws.mpm.settings import DISTANCE_TOLERANCE, SimulationSettings

NodeVelocities = Float[Tensor, "3 scenes nodes"]


def wall_nodes(grid: Grid, settings: SimulationSettings) -> Bool[Tensor, "2 3 nodes"]:
    """Which nodes of one scene belong to a wall: [0] walls at the low sides, [1] at the high sides, by axis.

    A wall acts on every node at most `wall_distance` [m] from a side, and on the padding beyond the side.
    """
    shape = (2, *grid.edges)
    sides = [_sides(grid, settings, axis) for axis in range(3)]
    by_axis = (
        sides[0][:, :, None, None].expand(shape),
        sides[1][:, None, :, None].expand(shape),
        sides[2][:, None, None, :].expand(shape),
    )
    return torch.stack(by_axis, dim=1).flatten(2)


def axis_walls(grid: Grid, settings: SimulationSettings) -> bytes:
    """What the nodes of the three axes are: 1 in a wall at the low side, 2 at the high side, 3 in both, 0 in none."""
    sides = [_sides(grid, settings, axis).long() for axis in range(3)]
    return bytes(torch.cat([low + 2 * high for low, high in sides]).tolist())


def wall_limits(walls: Bool[Tensor, "2 3 nodes"], dtype: torch.dtype) -> Float[Tensor, "2 3 nodes"]:
    """Least and largest velocity of nodes that walls let go [m/s]: 0 into a wall, infinite where there is none."""
    unlimited = torch.tensor((-math.inf, math.inf), dtype=dtype, device=walls.device)[:, None, None]
    return torch.where(walls, 0.0, unlimited)


def apply_walls(
    velocity: NodeVelocities, walls: Bool[Tensor, "2 3 nodes"], contact: str, limits: Tensor | None = None
) -> NodeVelocities:
    """Grid velocity after contact with walls without friction [m/s]; contacts as in mpm/contact.py.

    limits  wall_limits, where they are known
    """
    low, high = walls[:, :, None]
    if contact == "separate":
        least, most = (wall_limits(walls, velocity.dtype) if limits is None else limits)[:, :, None]
        return torch.clamp(velocity, least, most)
    if contact in ("slip", "sticky"):
        held = low | high
        return torch.where(held.any(0, keepdim=True) if contact == "sticky" else held, 0.0, velocity)
    into_wall = (low & (velocity < 0.0)) | (high & (velocity > 0.0))
    return torch.where(into_wall.any(0, keepdim=True), 0.0, velocity)  # stick of version 1


def apply_friction_walls(velocity: NodeVelocities, walls: Bool[Tensor, "2 3 nodes"], friction: float) -> NodeVelocities:
    """Grid velocity after contact with walls that separate and rub [m/s]: the six walls one after the other."""
    for axis in range(3):
        for side, sign in ((0, 1.0), (1, -1.0)):
            nodes = walls[side, axis].nonzero()[:, 0]
            if not len(nodes):
                continue
            normal = velocity.new_zeros(3, 1, 1)
            normal[axis] = sign
            met = velocity.index_select(2, nodes)
            after = velocity_after_contact(met, torch.zeros_like(met), normal, "separate", friction)
            velocity = velocity.index_copy(2, nodes, after)
    return velocity


def apply_colliders(
    velocity: NodeVelocities,
    mass: Float[Tensor, "scenes nodes"],
    grid: Grid,
    colliders: Sequence[Collider],
    time: float,
) -> tuple[NodeVelocities, Float[Tensor, "colliders scenes 3"]]:
    """Grid velocity after contact with colliders at a time [m/s], and the impulses that they gave [N s]."""
    impulses = []
    for collider in colliders:
        inside = _nodes_inside(collider, grid, velocity, time)
        if inside is None or not len(inside.numbers):
            impulses.append(velocity.new_zeros(velocity.shape[1], 3))
            continue
        met = velocity.index_select(2, inside.numbers)
        surface, normal = inside.velocity[:, None].expand_as(met), inside.normal[:, None]
        after = velocity_after_contact(met, surface, normal, collider.contact, collider.friction)
        impulses.append((mass[:, inside.numbers] * (after - met)).sum(2).T)
        velocity = velocity.index_copy(2, inside.numbers, after)
    return velocity, torch.stack(impulses) if impulses else velocity.new_zeros(0, velocity.shape[1], 3)


def _nodes_inside(collider: Collider, grid: Grid, like: Tensor, time: float) -> NodesInside | None:
    if not collider.moves and not collider.tensors():
        return _nodes_of_still(collider, grid, like.dtype, like.device)
    return collider.nodes_inside(_points(grid, like.dtype, like.device), DISTANCE_TOLERANCE * grid.spacing, time)


# A body moves little from step to step, and most colliders not at all.
@lru_cache(maxsize=32)
def _nodes_of_still(collider: Collider, grid: Grid, dtype: torch.dtype, device: torch.device) -> NodesInside | None:
    with torch.inference_mode(False), torch.no_grad():
        return collider.nodes_inside(_points(grid, dtype, device), DISTANCE_TOLERANCE * grid.spacing, 0.0)


@lru_cache(maxsize=8)
def _points(grid: Grid, dtype: torch.dtype, device: torch.device) -> Float[Tensor, "3 nodes"]:
    """Places of the nodes [m]."""
    with torch.inference_mode(False), torch.no_grad():
        axes = [grid.axis(axis).to(dtype=dtype, device=device) for axis in range(3)]
        return torch.stack(torch.meshgrid(*axes, indexing="ij")).flatten(1)


def _sides(grid: Grid, settings: SimulationSettings, axis: int) -> Bool[Tensor, "2 edge"]:
    """Which nodes of an axis belong to the wall at its low side, [0], and at its high side, [1]."""
    coordinate = grid.axis(axis)
    if settings.domain is None:
        return torch.zeros(2, len(coordinate), dtype=torch.bool)
    (low, *_), (high, *_) = (corner[axis:] for corner in settings.domain)
    reach = settings.wall_distance + DISTANCE_TOLERANCE * grid.spacing
    return torch.stack((coordinate <= low + reach, coordinate >= high - reach))
