"""Upright direction of a picture: against gravity."""

import numpy as np
from jaxtyping import Float

Gravity = tuple[float, float, float]


def has_floor(gravity: Gravity) -> bool:
    """Whether one of the walls is a floor: not without gravity."""
    return any(component != 0.0 for component in gravity)


def upright(position: Float[np.ndarray, "*frames 3"], gravity: Gravity) -> Float[np.ndarray, "*frames 3"]:
    """Positions turned about the middle of the domain so that the wall that gravity points to is below, where y is 0.

    That of oblique gravity is the one of its largest component. Without gravity nothing is turned.

    position  [m], (..., 3)
    gravity   [m/s^2]
    """
    axis = int(np.abs(gravity).argmax())
    up = -np.sign(gravity[axis])
    if up == 0.0 or (axis == 1 and up > 0.0):
        return position
    turned, centred = position.copy(), position - 0.5
    if axis == 1:  # half a turn about z
        turned[..., :2] = 0.5 - centred[..., :2]
    else:  # a quarter turn that takes the axis of gravity to that of y
        turned[..., 1], turned[..., axis] = 0.5 + up * centred[..., axis], 0.5 - up * centred[..., 1]
    return turned


def not_upright(position: Float[np.ndarray, "points 3"], gravity: Gravity) -> Float[np.ndarray, "points 3"]:
    """Where positions that `upright` has turned were before, the same units."""
    axis = int(np.abs(gravity).argmax())
    up = -np.sign(gravity[axis])
    if up == 0.0 or axis == 1:  # half a turn is its own inverse
        return upright(position, gravity)
    back, centred = position.copy(), position - 0.5
    back[..., axis], back[..., 1] = 0.5 + up * centred[..., 1], 0.5 - up * centred[..., axis]
    return back
