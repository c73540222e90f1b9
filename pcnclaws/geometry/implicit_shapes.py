"""Bodies that are not cubes: implicit functions of the unit box [-1/2, 1/2]^3, filled with a lattice of particles.

The lattice is that of the centres of equal cells, so each particle stands for the material around it.
"""

import math
from collections.abc import Callable
from functools import cache

import numpy as np
from jaxtyping import Bool, Float

Points = Float[np.ndarray, "points 3"]
Inside = Bool[np.ndarray, " points"]

TORUS_RADIUS, TUBE_RADIUS = 0.35, 0.15
STAR_RADIUS, STAR_NOTCH, STAR_THICKNESS, STAR_POINTS = 0.5, 0.25, 0.4, 5
BAR_WIDTH, BAR_TWIST = 0.4, math.pi
CAVITY = 0.6
BALL_RADIUS, SPIKE_LENGTH, SPIKE_RADIUS = 0.25, 0.5, 0.2
# With fewer particles along an edge of the box, thin parts of some body would be lost.
FEWEST_PER_EDGE = 8
# Points along an edge of the lattice that measures volumes: good to some 0.1 %.
MEASURING_PER_EDGE = 120


def filled_body(name: str, per_edge: int) -> Points:
    """The points of a body, one of BODIES, on the lattice of `per_edge` cells along each edge of the unit box."""
    along = (np.arange(per_edge) + 0.5) / per_edge - 0.5
    y, z = (axis.ravel() for axis in np.meshgrid(along, along, indexing="ij"))
    kept = []
    for x in along:  # slice by slice, which bounds the memory
        points = np.stack((np.full_like(y, x), y, z), axis=1)
        kept.append(points[BODIES[name](points)])
    return np.concatenate(kept)


@cache
def volume_fraction(name: str) -> float:
    """Volume of a body in units of that of its box [-], counted on a fine lattice."""
    return len(filled_body(name, MEASURING_PER_EDGE)) / MEASURING_PER_EDGE**3


def _torus(points: Points) -> Inside:
    """A ring around the z axis."""
    x, y, z = points.T
    return np.square(np.hypot(x, y) - TORUS_RADIUS) + np.square(z) <= TUBE_RADIUS**2


def _star(points: Points) -> Inside:
    """A five-pointed star in the x-y plane, one point up, extruded along z."""
    x, y, z = points.T
    half = math.pi / STAR_POINTS
    # folded onto the wedge between a point of the star and the notch beside it
    angle = np.abs((np.arctan2(x, y) + half) % (2.0 * half) - half)
    along, across = np.hypot(x, y) * np.cos(angle), np.hypot(x, y) * np.sin(angle)
    notch = STAR_NOTCH * np.array((math.cos(half), math.sin(half)))
    behind_edge = (notch[0] - STAR_RADIUS) * across - notch[1] * (along - STAR_RADIUS) >= 0.0
    return behind_edge & (np.abs(z) <= 0.5 * STAR_THICKNESS)


def _twisted_bar(points: Points) -> Inside:
    """A standing bar of square section that turns by BAR_TWIST from its foot to its top."""
    x, y, z = points.T
    cosine, sine = np.cos(BAR_TWIST * y), np.sin(BAR_TWIST * y)
    section = np.maximum(np.abs(cosine * x + sine * z), np.abs(cosine * z - sine * x))
    return (section <= 0.5 * BAR_WIDTH) & (np.abs(y) <= 0.5)


def _hollow_box(points: Points) -> Inside:
    """A cube with a closed cubic cavity."""
    distance = np.abs(points).max(1)
    return (distance > 0.5 * CAVITY) & (distance <= 0.5)


def _spiky_sphere(points: Points) -> Inside:
    """A ball with twelve cones, towards the corners of an icosahedron, that meet in its centre."""
    square = np.square(points).sum(1)
    inside = square <= BALL_RADIUS**2
    for direction in _icosahedron():
        height = points @ direction
        radius = SPIKE_RADIUS * (1.0 - height / SPIKE_LENGTH)
        inside |= (height >= 0.0) & (radius >= 0.0) & (square - height**2 <= radius**2)
    return inside


def _icosahedron() -> Float[np.ndarray, "corners 3"]:
    """Unit vectors to the twelve corners of an icosahedron."""
    golden = 0.5 * (1.0 + math.sqrt(5.0))
    corners = [(0.0, one, other) for one in (-1.0, 1.0) for other in (-golden, golden)]
    turned = [np.roll(corner, turn) for corner in corners for turn in range(3)]
    return np.array(turned) / math.hypot(1.0, golden)


BODIES: dict[str, Callable[[Points], Inside]] = {
    "torus": _torus,
    "star": _star,
    "twisted_bar": _twisted_bar,
    "hollow_box": _hollow_box,
    "spiky_sphere": _spiky_sphere,
}
