"""Plausibility of units: what cannot be seconds and metres is refused, what is doubtful gets a line."""

import logging
import math

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from pcnclaws.errors import UserError
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.simulation.records import SceneRecord

log = logging.getLogger(__name__)

# Steps of a recording: more than the first are doubtful, more than the second run for days.
DOUBTFUL_STEPS, MOST_STEPS = 1e5, 1e7
# Frames of free flight that an acceleration needs, and cells within which a body feels a wall.
FEWEST_FRAMES, REACH = 5, 1.5
# Factors from gravity of an acceleration that are doubtful, and that no experiment explains.
DOUBTFUL, IMPOSSIBLE = 0.5, 30.0
# Standard errors by which an acceleration differs from what it should be, and parts of it that they are.
SIGNIFICANT, PRECISE = 4.0, 0.1
# What an acceleration is multiplied with by a wrong unit.
UNITS = {
    "positions in mm": 1e3,
    "positions in cm": 1e2,
    "times in ms": 1e-6,
    "times in microseconds": 1e-12,
    "times in minutes": 3.6e3,
}
LIKE_A_UNIT = 0.3
# Spacing of particles over the edge of the cubes that they stand for: a lattice has about 1.
SPACING_FACTOR = 10.0
LOOKED_AT = 1000
# Markers that show a leap of one of them, and how much farther than their median it goes.
FEWEST_MARKERS, LEAP = 3, 10.0

Frames = Float[np.ndarray, "frames points 3"]


def check_record(record: SceneRecord) -> None:
    """As check_motion, for a recorded scene, and a line where its volumes do not fit its positions."""
    check_motion(record.label, record.time - record.time[0], record.position, record.settings)
    check_spacing(record.label, record.position[0], record.volume)


def check_motion(
    where: str,
    time: Float[np.ndarray, " frames"],
    position: Frames,
    settings: SimulationSettings,
    body: Float[np.ndarray, "particles 3"] | None = None,
) -> None:
    """Looks at the number of steps of a motion, and at its acceleration in free flight.

    time      since the start [s]
    position  [m], NaN where a point was not seen
    body      all particles at the start [m], where the points are some of them
    raises    UserError for less than one step or far too many, and for an acceleration of another order than gravity
    """
    position = position.astype(np.float64)
    acceleration = flight_acceleration(time, position, settings, position[0] if body is None else body)
    if acceleration is not None:
        _check_acceleration(where, time, *acceleration, np.array(settings.gravity))
    check_steps(where, time, settings)


def check_steps(where: str, time: Float[np.ndarray, " frames"], settings: SimulationSettings) -> None:
    """Looks at the number of steps of a motion: UserError for less than one and for far too many."""
    steps = float(time[-1]) / settings.time_step
    if len(time) > 1 and (steps < 1.0 or steps > DOUBTFUL_STEPS):
        what = f"{where}: its times span {time[-1]:.4g} s, {steps:.3g} steps of {settings.time_step:g} s"
        hint = "seconds; are they frame numbers?" if _whole(time) else "seconds; are they in another unit, such as ms?"
        if steps < 1.0 or steps > MOST_STEPS:
            raise UserError(f"{what}; accepted: {hint}")
        log.warning("%s; expected: %s", what, hint)


def check_jumps(
    where: str,
    time: Float[np.ndarray, " frames"],
    position: Frames,
    names: list[str],
    body: Float[np.ndarray, "particles 3"],
) -> None:
    """Refuses a marker that leaps over the length of the body between two frames in which the others stay.

    raises  UserError naming marker and time
    """
    if len(names) < FEWEST_MARKERS or len(time) < 2:
        return
    longest = float(np.ptp(body, axis=0).max())
    moved = np.linalg.norm(np.diff(position, axis=0), axis=2)
    seen = np.isfinite(moved)
    others = np.nanmedian(np.where(seen.any(1, keepdims=True), moved, 0.0), axis=1, keepdims=True)
    leap = np.where(seen, moved, 0.0) - LEAP * others
    frame, marker = np.unravel_index(int(np.argmax(leap)), leap.shape)
    if leap[frame, marker] > longest:
        span = float(time[frame + 1] - time[frame])
        raise UserError(
            f"{where}: marker '{names[marker]}' moves {moved[frame, marker]:.3g} m within {span:.3g} s at "
            f"{time[frame + 1]:.4g} s, the others {others[frame, 0]:.2g} m; accepted: markers that stay on the body, "
            f"{longest:.3g} m long; another marker, or another unit?"
        )


def check_spacing(
    where: str, position: Float[np.ndarray, "particles 3"], volume: Float[np.ndarray, " particles"]
) -> None:
    """A line where the distances of particles are of another order than the cubes of their volumes."""
    if len(position) < 2:
        return
    chosen = np.linspace(0, len(position) - 1, min(LOOKED_AT, len(position))).astype(np.int64)
    distance = float(np.median(KDTree(position).query(position[chosen], k=2)[0][:, 1]))
    edge = float(np.median(volume)) ** (1.0 / 3.0)
    if not edge / SPACING_FACTOR <= distance <= edge * SPACING_FACTOR:
        log.warning(
            "%s: its particles lie %.2g m apart, but their volumes are those of cubes of %.2g m; expected: m and m^3",
            where,
            distance,
            edge,
        )


def flight_acceleration(
    time: Float[np.ndarray, " frames"],
    position: Frames,
    settings: SimulationSettings,
    body: Float[np.ndarray, "particles 3"],
) -> tuple[np.ndarray, np.ndarray] | None:
    """Mean acceleration of the points before a wall can act, with its standard errors [m/s^2], each (3,).

    None where too few frames show it.
    """
    if settings.colliders or settings.loads:
        return None
    begun = np.isfinite(position[0]).all(1)
    position = position[:, begun]
    seen = np.isfinite(position).all(2)
    frames = np.flatnonzero(np.count_nonzero(seen, axis=1))
    lower, upper = settings.within(settings.wall_distance + REACH * settings.grid_spacing)
    low, high = np.nanmin(position[frames], axis=1), np.nanmax(position[frames], axis=1)
    # as far as the body reaches beyond the points
    low, high = low - (low[0] - body.min(0)), high + (body.max(0) - high[0])
    flying = ((low > lower) & (high < upper)).all(1)
    frames = frames[: int(np.argmin(flying)) if not flying.all() else len(frames)]
    if len(frames) < FEWEST_FRAMES:
        return None
    moved = np.nanmean(position[frames] - position[0], axis=1)
    length = float(time[frames[-1]])
    share = time[frames] / length
    terms = np.stack((np.ones_like(share), share, 0.5 * share**2), axis=1)
    fitted = np.linalg.lstsq(terms, moved, rcond=None)[0]
    variance = np.square(moved - terms @ fitted).sum(0) / (len(frames) - 3)
    error = np.sqrt(variance * np.linalg.inv(terms.T @ terms)[2, 2])
    return fitted[2] / length**2, error / length**2


def _check_acceleration(
    where: str,
    time: Float[np.ndarray, " frames"],
    found: np.ndarray,
    error: np.ndarray,
    gravity: np.ndarray,
) -> None:
    size, wanted, doubt = (float(np.linalg.norm(vector)) for vector in (found, gravity, error))
    away = float(np.linalg.norm(found - gravity))
    if wanted == 0.0 or size == 0.0 or away < max(DOUBTFUL * wanted, SIGNIFICANT * doubt):
        return
    what = f"{where}: its first frames accelerate by {_shown(found)} m/s^2, gravity is {_shown(gravity)} m/s^2"
    ratio, precise = size / wanted, doubt < PRECISE * size
    along = float(found @ gravity) > 0.9 * size * wanted
    if precise and along and not 1.0 / IMPOSSIBLE < ratio < IMPOSSIBLE:
        raise UserError(f"{what}; accepted: metres and seconds; {_unit(ratio, _whole(time))}?")
    if precise:
        log.warning("%s; %s", what, f"{_unit(ratio, _whole(time))}?" if along else "do the axes agree?")


def _unit(ratio: float, whole: bool) -> str:
    """What would make accelerations `ratio` times as large as they are."""
    factor = math.sqrt(ratio)
    for name, of_unit in UNITS.items():
        if abs(ratio / of_unit - 1.0) < LIKE_A_UNIT:
            return name
    if whole and ratio < 1.0:
        return f"times in frames, {1.0 / factor:.3g} a second"
    if ratio < 1.0:
        return f"times too long by a factor of {1.0 / factor:.3g}"
    return f"times too short by a factor of {factor:.3g}, or positions too large by {ratio:.3g}"


def _whole(time: Float[np.ndarray, " frames"]) -> bool:
    """Whether all times are whole numbers, as those of frames are."""
    return bool(np.array_equal(time, np.rint(time)))


def _shown(vector: np.ndarray) -> str:
    return f"({', '.join(f'{component:.3g}' for component in vector)})"
