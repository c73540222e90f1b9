"""Contact of the material with a wall or a collider, on the velocities of grid nodes."""

import math
from typing import TypeAlias

import torch
from jaxtyping import Float
from torch import Tensor

from pcnclaws.errors import UserError
from pcnclaws.mpm.numbers import Number, plain

NodeVectors: TypeAlias = Float[Tensor, "3 *nodes"]

CONTACTS = ("separate", "slip", "sticky")
# The contact of walls that files of version 1 call stick: all of the velocity goes where it points into a wall.
VERSION_1_STICK = "stick of version 1"


def velocity_after_contact(
    velocity: NodeVectors, obstacle: NodeVectors, normal: Tensor, contact: str, friction: Number
) -> NodeVectors:
    """Velocity of nodes after contact with an obstacle [m/s], (3, ..., nodes).

    With u = v - v_c, the velocity relative to the obstacle's, and n its outward normal:

        separate  where u n < 0: loses u n, and of the tangential part u_t at most mu |u n| (Coulomb friction)
        slip      loses u n, whatever its sign
        sticky    becomes v_c

    velocity, obstacle  v and v_c [m/s]
    normal              n [-]
    friction            mu [-]
    source              Stomakhin et al. 2013, "A material point method for snow simulation", section 8
    """
    if contact == "sticky":
        return obstacle
    relative = velocity - obstacle
    across = (relative * normal).sum(0, keepdim=True)
    along = relative - across * normal
    if contact == "slip":
        return obstacle + along
    inward = across < 0.0
    after = along if isinstance(friction, float) and friction == 0.0 else along * _share_left(along, across, friction)
    return torch.where(inward, obstacle + after, velocity)


def require_friction(option: str, friction: Number, contact_option: str, contact: str) -> None:
    """Refuses a coefficient that is none, or that has no effect, with a UserError."""
    value = plain(friction)
    if not (math.isfinite(value) and value >= 0.0):
        raise UserError(f"{option}={value} is out of range; accepted: a finite number from 0")
    if value > 0.0 and contact != "separate":
        raise UserError(f"{option}={value} has no effect beside {contact_option}={contact}; accepted: separate, or 0")


def _share_left(along: NodeVectors, across: Tensor, friction: Number) -> Tensor:
    """What friction leaves of the tangential velocity: max(0, 1 - mu |u n| / |u_t|), 0 where there is none."""
    squared = along.square().sum(0, keepdim=True)
    moving = squared > 0.0
    speed = torch.where(moving, squared, 1.0).sqrt()
    return torch.where(moving, (1.0 + friction * across / speed).clamp_min(0.0), 0.0)
