"""Placement of particles: they belong into the domain and outside its walls."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from pcnclaws.errors import UserError
from pcnclaws.mpm.numbers import scalars, span_holds
from pcnclaws.mpm.settings import UNIT_BOX, SimulationSettings
from pcnclaws.simulation.collider_distance import collider_distance
from pcnclaws.simulation.physical_states import domain_in_words, place_outside

# Accepted rounding of a position on the surface of the wall layer [m].
WALL_TOLERANCE = 1e-6
# The volumes of a body may add up to this much of that of the domain, by rounding.
VOLUME_TOLERANCE = 1.001


def require_inside(
    position: Float[np.ndarray, "particles 3"], settings: SimulationSettings, what: str, slack: float = 0.0
) -> None:
    """Refuses particles outside the domain, inside the wall layer or a collider with a UserError that names the first.

    what   the scene or the option in the error message
    slack  accepted depth inside the wall layer [m]
    """
    _require_off_colliders(position, settings, what, slack)
    limit = max(settings.wall_distance - slack, 0.0)
    low, high = settings.within(0.0)
    # in an unbounded domain it is a number that a coordinate must be
    room = np.minimum(position - low, high - position) if settings.domain else np.where(np.isfinite(position), 1e30, -1)
    depth = limit - room.min(1)
    wrong = np.flatnonzero(~(depth <= WALL_TOLERANCE * (limit > 0.0)))
    if len(wrong) == 0:
        return
    first = int(wrong[0])
    outside = not np.all((position[first] >= low) & (position[first] <= high))
    layer = f"inside the wall layer (wall_distance={settings.wall_distance:g} m)"
    place = f"outside {domain_in_words(settings.domain or UNIT_BOX)}" if outside else layer
    hint = length_hint(position) if outside and settings.domain == UNIT_BOX else ""
    others = f" and {len(wrong) - 1} more" if len(wrong) > 1 else ""
    lower, upper = settings.within(limit)
    where = place_outside(position[first].tolist(), lower, upper)
    raise UserError(
        f"{what}: particle {first}{others} at {where} m is {place}; accepted: {_between(lower, upper)} m{hint}"
    )


def require_loaded(position: Float[np.ndarray, "particles 3"], settings: SimulationSettings, what: str) -> None:
    """Refuses loads that act on no particle with a UserError that names the first."""
    for number, load in enumerate(settings.loads):
        low, high = (np.array(scalars(corner)) for corner in (load.low, load.high))
        if not np.any(np.all((position >= low) & (position <= high), axis=1)):
            first, last = position.min(0), position.max(0)
            raise UserError(
                f"{what}: loads[{number}] from {low.tolist()} to {high.tolist()} m acts on no particle; accepted: a "
                f"box that holds some of those from {np.round(first, 4).tolist()} to {np.round(last, 4).tolist()} m"
            )


def require_volume(volume: Float[np.ndarray, " particles"], settings: SimulationSettings, what: str) -> None:
    """Refuses a body that is larger than the domain, as one in other units is, with a UserError."""
    most = settings.volume
    if float(volume.sum(dtype=np.float64)) > VOLUME_TOLERANCE * most:
        raise UserError(
            f"{what}: 'volume' sums to {volume.sum():.3g}, more than the domain holds; accepted: m^3, at most {most:g}"
        )


def _require_off_colliders(
    position: Float[np.ndarray, "particles 3"], settings: SimulationSettings, what: str, slack: float
) -> None:
    """Refuses particles inside colliders; a sticky one may hold a part of a body."""
    for number, collider in enumerate(settings.colliders):
        if collider.contact == "sticky" or not span_holds(collider.start, collider.end, settings.start_time):
            continue
        distance = collider_distance(collider, position, settings.start_time)
        if not np.isfinite(distance).all():
            place = ", ".join(f"{x:.4g}" for x in position[np.argmin(np.isfinite(distance))])
            raise UserError(
                f"scene.colliders[{number}] ({collider.shape.word}): its distance at ({place}) m is not finite; "
                "accepted: a function that gives finite distances"
            )
        inside = np.flatnonzero(distance < -slack - WALL_TOLERANCE)
        if len(inside):
            others = f" and {len(inside) - 1} more" if len(inside) > 1 else ""
            place = ", ".join(f"{x:.4g}" for x in position[inside[0]])
            raise UserError(
                f"{what}: particle {inside[0]}{others} at ({place}) m is inside scene.colliders[{number}] "
                f"({collider.shape.word}); accepted: bodies outside of colliders, or contact=sticky, which holds them"
            )


def _between(lower: Sequence[float], upper: Sequence[float]) -> str:
    """In words, what coordinates may be."""
    if len(set(lower)) == len(set(upper)) == 1:
        return f"every coordinate from {lower[0]:.10g} to {upper[0]:.10g}"
    ends = zip("xyz", lower, upper, strict=True)
    return ", ".join(f"{axis} from {low:.10g} to {high:.10g}" for axis, low, high in ends)


def length_hint(position: np.ndarray) -> str:
    """Units in which positions far outside of the domain would lie inside, as a question behind a message."""
    seen = position[np.isfinite(position)]
    fitting = [
        unit
        for unit, factor in (("cm", 1e-2), ("mm", 1e-3))
        if len(seen) and np.abs(seen).max() > 1.5 and seen.min() * factor >= -0.5 and seen.max() * factor <= 1.5
    ]
    return f"; positions in {' or '.join(fitting)}?" if fitting else ""
