"""Does a recording begin as its file says: undeformed, and with its initial velocities? One line for each file if not.

Such a recording is still simulated as the file says. What follows is then an error of the file, and looks like one of
the law.
"""

import logging
from collections.abc import Iterable

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from pcnclaws.simulation.records import SceneRecord

log = logging.getLogger(__name__)

# Cells within which a body feels a wall of which its particles are not yet in the layer.
REACH = 2.0
# Accepted jump of the mean velocity between the start and the first frames, in parts of the speed.
JUMP = 0.1
# The same of the motion about the mean: a start with C = 0 loses up to half of the spin of a small body at once.
SPIN_LOST = 0.7
# Accepted elastic strain at a restart state beyond twice what the positions moved by since the start [-].
STRAIN = 0.02
# So many particles are looked at, each with so many neighbours.
LOOKED_AT, NEIGHBOURS = 200, 12

Vectors = Float[np.ndarray, "particles 3"]


def name_contradictions(records: Iterable[SceneRecord]) -> None:
    """One line for each file with scenes that do not begin as they say: the first of them, and how many more."""
    found: dict[str, list[str]] = {}
    for record in records:
        text = contradiction(record)
        if text is not None:
            found.setdefault(record.source, []).append(f"{record.label}: {text}")
    for lines in found.values():
        more = f" (and {len(lines) - 1} more scenes)" if len(lines) > 1 else ""
        log.warning("%s; the start is taken for undeformed, and for moving as initial_velocity says%s", lines[0], more)


def contradiction(record: SceneRecord) -> str | None:
    """In words, what of the recorded motion cannot follow from the start that the file names; None for nothing."""
    if record.initial_velocity is None or len(record.time) < 2:
        return None
    return _of_velocity(record, record.initial_velocity.astype(np.float64)) or _of_deformation(record)


def _of_velocity(record: SceneRecord, start: Vectors) -> str | None:
    """Compares the first frames with free flight, on the axes along which no wall can have acted.

    Stress moves no centre of mass. About it, motion that goes on from frame to frame as it was is not yet changed by
    stress: a jump at the start that is larger than the changes after it is none of physics. Noise changes all frames.
    """
    position, settings = record.position[:3].astype(np.float64), record.settings
    seen = np.isfinite(position).all((0, 2))
    if not seen.any():
        return None
    position, start, share = position[:, seen], start[seen], record.volume[seen] / record.volume[seen].sum()
    time, gravity = record.time[:3] - record.time[0], np.array(settings.gravity)
    first = float(time[1])
    moved = position[1] - position[0]
    free = first * start + 0.5 * first * (first + settings.time_step) * gravity

    flying = _without_walls(record, np.stack((position[0], position[1], position[0] + free)))
    if not flying.any():
        return None
    jump = (moved - free) / first
    change = np.zeros_like(jump)
    if len(time) > 2:
        change = (position[2] - position[1]) / (time[2] - first) - moved / first - 0.5 * time[2] * gravity
    speed = max(_size(start), _size(moved / first))
    mean_jump, mean_change = share @ jump, share @ change
    rounding = np.linalg.norm(gravity) * first  # a velocity half a frame later or earlier
    noise = 5.0 * _size(change) / np.sqrt(len(jump))
    accepted = max(JUMP * speed, rounding, noise, 3.0 * float(np.abs(mean_change[flying]).max()))
    if np.linalg.norm(mean_jump[flying]) > accepted:
        return (
            f"between the first two frames its particles move by {_shown(share @ moved)} m on average, "
            f"initial_velocity says {_shown(share @ free)} m"
        )
    if not flying.all() or len(time) < 3:
        return None
    about = _size(start - share @ start), _size((moved - share @ moved) / first)
    accepted = max(SPIN_LOST * max(about), 0.5 * JUMP * speed, rounding, 3.0 * _size(change - mean_change))
    if _size(jump - mean_jump) > accepted:
        return (
            f"between the first two frames its particles move by {about[1] * first:.3g} m about their mean, "
            f"initial_velocity says {about[0] * first:.3g} m, or other directions"
        )
    return None


def _of_deformation(record: SceneRecord) -> str | None:
    """Compares the strain of the first restart state after the start with how the positions moved until then."""
    keyframes = record.keyframes
    if keyframes is None or keyframes.step[0] == 0 or record.position.shape[1] <= NEIGHBOURS:
        return None
    start, later = record.position[0].astype(np.float64), keyframes.position[0].astype(np.float64)
    chosen = np.linspace(0, len(start) - 1, min(LOOKED_AT, len(start))).astype(np.int64)
    around = np.asarray(KDTree(start).query(start[chosen], k=NEIGHBOURS + 1)[1])[:, 1:]
    before, after = (field[around] - field[chosen][:, None] for field in (start, later))
    moved = np.swapaxes(np.linalg.pinv(before) @ after, 1, 2)
    stored, seen = _strain(keyframes.deformation[0][chosen].astype(np.float64)), _strain(moved)
    if stored <= 2.0 * seen + STRAIN:
        return None
    return (
        f"its restart state at step {keyframes.step[0]} is strained by {stored:.2g}, while its particles moved by a "
        f"strain of {seen:.2g} since the start"
    )


def _strain(gradient: Float[np.ndarray, "particles 3 3"]) -> float:
    """Median norm of the logarithmic strains of deformation gradients [-]."""
    stretch = np.maximum(np.linalg.svd(gradient, compute_uv=False), 1e-9)
    return float(np.median(np.linalg.norm(np.log(stretch), axis=1)))


def _without_walls(record: SceneRecord, position: Float[np.ndarray, "times particles 3"]) -> np.ndarray:
    """The axes along which no wall is near: walls without friction push along one axis, others hold a body on all."""
    settings = record.settings
    if settings.colliders or settings.loads:
        return np.zeros(3, dtype=bool)
    low, high = settings.within(settings.wall_distance + REACH * settings.grid_spacing)
    away = (position.min((0, 1)) > low) & (position.max((0, 1)) < high)
    pushes = settings.boundary in ("separate", "slip") and settings.friction == 0.0
    return away if pushes or away.all() else np.zeros(3, dtype=bool)


def _size(vectors: Vectors) -> float:
    """Root mean square of the lengths."""
    return float(np.sqrt(np.square(vectors).sum(1).mean()))


def _shown(vector: np.ndarray) -> str:
    return f"({', '.join(f'{component:.3g}' for component in vector)})"
