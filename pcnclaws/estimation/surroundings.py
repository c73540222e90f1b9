"""Unknowns of what stands around a body: where its walls are, how they rub, which way gravity points; and its size.

Each moves the scene as a whole; its derivative is the central difference of two rollouts.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from torch import Tensor

from pcnclaws.estimation.unknowns import FRICTION, SIZE, TILTS, WALL_SCALE, WALLS, Unknowns
from pcnclaws.mpm.settings import SimulationSettings

# Central differences go so far to either side, in coordinates: far above rounding, far below what bends the motion.
DIFFERENCE = 0.02
# Rounding of the simulation in single precision [m]: the analytic law's own error, and the least noise there is.
ROUNDING = 3e-7
# Walls that a body meets move it by about as much as they are displaced; where it lies on the grid, by less than this
# share of that.
LEAST_MOVED = 0.1


def is_felt(name: str, rate: Tensor) -> bool:
    """Whether an unknown has an influence, by the change of the motion with its coordinate [m]."""
    size = float(rate.square().mean().sqrt())
    return size > (LEAST_MOVED * WALL_SCALE if name in WALLS else ROUNDING / DIFFERENCE)


def displacement(unknowns: Unknowns, values: np.ndarray) -> Float[np.ndarray, " 3"]:
    """Of walls and colliders from where the settings put them [m]."""
    away = np.zeros(3)
    for axis, name in enumerate(WALLS):
        for k in unknowns.index(name):
            away[axis] = values[k]
    return away


def size_of(unknowns: Unknowns, values: np.ndarray) -> float:
    """Of the body, over the size that is given [-]."""
    return 1.0 + sum(float(values[k]) for k in unknowns.index(SIZE))


def gravity_of(unknowns: Unknowns, values: np.ndarray, gravity: Sequence[float]) -> Float[np.ndarray, " 3"]:
    """Gravity of the settings, turned by the tilts that are sought [m/s^2].

    The tilts are the components of a rotation vector across gravity [deg]; its size stays as it is.
    """
    given = np.array(gravity, dtype=np.float64)
    turn = np.zeros(3)
    for axis, name in zip(across(gravity), TILTS, strict=True):
        for k in unknowns.index(name):
            turn[axis] = np.radians(values[k])
    angle = float(np.linalg.norm(turn))
    if angle == 0.0:
        return given
    axis = turn / angle
    along = axis * float(axis @ given)
    return along + np.cos(angle) * (given - along) + np.sin(angle) * np.cross(axis, given)


def across(gravity: Sequence[float]) -> tuple[int, int]:
    """The two axes of the domain that are across the largest component of gravity."""
    along = int(np.argmax(np.abs(gravity)))
    first, second = (axis for axis in range(3) if axis != along)
    return first, second


def friction_of(unknowns: Unknowns, values: np.ndarray, settings: SimulationSettings) -> float:
    """Coefficient of friction of the walls [-]."""
    sought = unknowns.index(FRICTION)
    return float(values[sought[0]]) if sought else settings.friction
