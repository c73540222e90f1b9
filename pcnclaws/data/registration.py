"""Registration: the rigid motion from the frame of the cameras to that of the simulation, and what it leaves.

Either from fixed markers whose places are known, or by laying the markers of the start on the surface of the body.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from pcnclaws.data.length_units import unit_of_ratio
from pcnclaws.data.markers import surface_particles
from pcnclaws.errors import UserError

Points = Float[np.ndarray, "points 3"]
Particles = Float[np.ndarray, "particles 3"]
# Fewest markers of known place, and of unknown place on a shape.
KNOWN, ON_SHAPE = 3, 4
# Largest residual of known places over their extent; below this extent across a line, they lie on it.
LARGEST, ON_A_LINE = 0.05, 1e-2
# A mirror image that fits so many times as well, and by this share of the reach better, is taken for one.
MIRRORED, MIRRORED_LEAST = 3.0, 0.02
ITERATIONS, STARTS, AROUND, AS_GOOD = 200, 100, 4, 1.1


@dataclass(frozen=True)
class Registration:
    """Place in the simulation's frame = rotation @ place + shift [m].

    residual  what it leaves of each marker that it was fitted to [m], by name
    others    how many other placements fit the body as well
    """

    rotation: Float[np.ndarray, "3 3"]
    shift: Float[np.ndarray, "3"]
    residual: Mapping[str, float]
    others: int = 0

    def __call__(self, position: Float[np.ndarray, "*frames 3"]) -> Float[np.ndarray, "*frames 3"]:
        """Positions in the frame of the simulation."""
        return position @ self.rotation.T + self.shift

    @property
    def rms(self) -> float:
        """Of the residual [m]."""
        return math.sqrt(sum(value**2 for value in self.residual.values()) / len(self.residual))

    def words(self) -> str:
        """In words, for one line."""
        worst = max(self.residual, key=lambda name: self.residual[name])
        angle = math.degrees(math.acos(np.clip(0.5 * (np.trace(self.rotation) - 1.0), -1.0, 1.0)))
        more = f"; {self.others} other placements fit as well, this one turns least" if self.others else ""
        return (
            f"registered by {len(self.residual)} markers to {self.rms:.3g} m RMS, marker '{worst}' to "
            f"{self.residual[worst]:.3g} m; turned by {angle:.4g} degrees{more}"
        )

    def plain(self) -> dict[str, Any]:
        """As plain values."""
        return {
            "rotation": self.rotation.tolist(),
            "shift": self.shift.tolist(),
            "residual": dict(self.residual),
            "rms": self.rms,
            "other_placements": self.others,
        }


def rigid_motion(source: Points, target: Points, mirror: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Rotation and shift that lay points on others with the least squares of the distances.

    mirror  a rotation and a reflection instead
    source  Kabsch 1976, Acta Crystallographica A32, 922
    """
    centre, other = source.mean(0), target.mean(0)
    left, _, right = np.linalg.svd((source - centre).T @ (target - other))
    sign = np.sign(np.linalg.det(left @ right)) * (-1.0 if mirror else 1.0)
    rotation = (left @ np.diag((1.0, 1.0, sign)) @ right).T
    return rotation, other - rotation @ centre


def by_fixed_markers(where: str, marker: Points, place: Points, names: Sequence[str], units: str) -> Registration:
    """The registration by markers whose places in the simulation's frame are known.

    marker  as observed [m]
    place   where they are in the simulation's frame [m]
    units   of the file, for what is said of them
    raises  UserError for fewer than three, for markers on a line, other units, a mirrored frame, places that do not fit
    """
    if len(names) < KNOWN:
        raise UserError(f"{where}: observation.frame names {len(names)} markers; accepted: {KNOWN} or more")
    spread, wide = (_extents(points) for points in (marker, place))
    for what, extent in (("places", wide), ("markers", spread)):
        if extent[1] < ON_A_LINE * extent[0]:
            raise UserError(f"{where}: the {what} of observation.frame lie on a line; accepted: three that do not")
    ratio = float(wide[0] / spread[0])
    if (unit := unit_of_ratio(ratio, units)) is not None:
        raise UserError(
            f"{where}: its markers of observation.frame are {1.0 / ratio:.3g} times as far apart as their places; "
            f"observation.units={units} is in doubt; positions in {unit}?"
        )
    rotation, shift = rigid_motion(marker, place)
    distance = np.linalg.norm(marker @ rotation.T + shift - place, axis=1)
    turned, moved = rigid_motion(marker, place, mirror=True)
    mirrored = float(np.linalg.norm(marker @ turned.T + moved - place, axis=1).max())
    worst = int(np.argmax(distance))
    if distance[worst] > LARGEST * wide[0]:
        hint = "; a mirrored frame fits: is an axis turned around?" if MIRRORED * mirrored < distance[worst] else ""
        raise UserError(
            f"{where}: no registration: marker '{names[worst]}' stays {distance[worst]:.3g} m from its place of "
            f"observation.frame; accepted: places that fit to {LARGEST * wide[0]:.2g} m{hint}"
        )
    return Registration(rotation, shift, dict(zip(names, distance.tolist(), strict=True)))


def on_shape(
    where: str, marker: Points, names: Sequence[str], body: Particles, reach: float, units: str
) -> Registration:
    """The registration that lays markers on the surface of the body: iterated closest points, from many rotations.

    reach   largest accepted distance of a marker from the nearest particle of the surface [m]
    source  Besl and McKay 1992, IEEE Transactions on Pattern Analysis and Machine Intelligence 14, 239
    raises  UserError for fewer than four markers or a plane of them, other units, a mirrored frame, markers that fit
            nowhere
    """
    spread = _extents(marker)
    if len(names) < ON_SHAPE or spread[2] < ON_A_LINE * spread[0]:
        raise UserError(
            f"{where}: observation.frame=fit has {len(names)} markers at the start"
            f"{' in a plane' if len(names) >= ON_SHAPE else ''}; accepted: {ON_SHAPE} or more, not in a plane, for the "
            "six unknowns of a frame"
        )
    unit = unit_of_ratio(float(np.ptp(body, axis=0).max() / np.ptp(marker, axis=0).max()), units, among=5.0)
    if unit is not None:
        raise UserError(
            f"{where}: its markers span {np.ptp(marker, axis=0).max():.3g} m and the body "
            f"{np.ptp(body, axis=0).max():.3g} m; observation.units={units} is in doubt; positions in {unit}?"
        )
    surface = KDTree(body[surface_particles(body)])
    upright = [_closest(surface, marker, turn) for turn in _turns()]
    best = min(upright, key=lambda one: one[0])
    mirrored = min(_closest(surface, marker, turn, mirror=True)[0] for turn in _turns())
    if best[0] > reach or MIRRORED * mirrored + MIRRORED_LEAST * reach < best[0]:
        hint = "; a mirrored frame fits: is an axis turned around?" if MIRRORED * mirrored < best[0] else ""
        raise UserError(
            f"{where}: no registration: the markers stay {best[0]:.3g} m from the surface of the body; accepted: "
            f"{reach:.3g} m{hint}"
        )
    alike = [one for one in upright if one[0] <= AS_GOOD * best[0] + 1e-9]
    least = max(alike, key=lambda one: float(np.trace(one[1])))
    distinct: list[np.ndarray] = []
    for _, rotation, _ in alike:
        if all(float(np.trace(rotation @ known.T)) < 2.9 for known in distinct):
            distinct.append(rotation)
    _, rotation, shift = least
    distance = surface.query(marker @ rotation.T + shift)[0]
    return Registration(rotation, shift, dict(zip(names, distance.tolist(), strict=True)), len(distinct) - 1)


def _extents(points: Points) -> np.ndarray:
    """Root mean squares along the principal axes [m], the largest first."""
    values = np.linalg.svd(points - points.mean(0), compute_uv=False) / math.sqrt(len(points))
    return np.pad(values, (0, 3 - len(values)))


@cache
def _turns() -> list[np.ndarray]:
    """Rotations to start from: none, those of a cube, and others at random, always the same."""
    found = [Rotation.identity().as_matrix()]
    found += list(Rotation.create_group("O").as_matrix())
    return found + list(Rotation.random(STARTS, rng=np.random.default_rng(0)).as_matrix())


def _closest(
    surface: KDTree, marker: Points, turn: np.ndarray, mirror: bool = False
) -> tuple[float, np.ndarray, np.ndarray]:
    """RMS distance from the surface [m], rotation and shift, of closest points iterated from a rotation."""
    rotation = turn @ np.diag((1.0, 1.0, -1.0)) if mirror else turn
    low, high = surface.mins, surface.maxes
    shift = 0.5 * (low + high) - rotation @ (0.5 * (marker.min(0) + marker.max(0)))
    distance = np.inf
    for _ in range(ITERATIONS):
        before = distance
        away, near = surface.query(marker @ rotation.T + shift, k=AROUND)
        weight = 1.0 / np.square(np.maximum(away, 1e-9))
        target = np.einsum("mk,mkc->mc", weight / weight.sum(1, keepdims=True), surface.data[near])
        distance = float(np.sqrt(np.mean(np.square(marker @ rotation.T + shift - target))))
        if distance > (1.0 - 1e-4) * before:
            break
        rotation, shift = rigid_motion(marker, target, mirror)
    return distance, rotation, shift
