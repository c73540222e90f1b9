"""Observations from files: a trajectory file of ours, or markers: a table, or motion capture in a C3D file.

time, marker, x, y, z        a CSV file with this header, in seconds and metres; an empty coordinate was not seen
time_s, <marker>_x, ...      the same with a line for each frame
"""

import csv
import io
import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from pcnclaws.atomic import replaced_file
from pcnclaws.data.first_motion import name_contradictions
from pcnclaws.data.hdf5 import read_scenes, scene_names
from pcnclaws.data.marker_tables import COLUMNS
from pcnclaws.data.markers import followed_particles
from pcnclaws.data.motion_capture import Capture, captured
from pcnclaws.data.observation import Observation
from pcnclaws.data.units import check_jumps, check_motion, check_record
from pcnclaws.errors import UserError
from pcnclaws.geometry.shapes import PointCloud
from pcnclaws.mpm.settings import UNIT_BOX, SimulationSettings
from pcnclaws.simulation.placement import length_hint, require_inside
from pcnclaws.simulation.records import SceneRecord

log = logging.getLogger(__name__)

# Significant digits of coordinates in single and in double precision, and of times at least.
SINGLE_DIGITS, DOUBLE_DIGITS, TIME_DIGITS = 7, 16, 9
# Positions beyond the domain by more than this are in other units [m].
BEYOND = 0.5
# Frames this near to the start are at the start [s].
AT_START = 1e-6


def observed_record(path: str | Path, name: str | None, material: str) -> SceneRecord:
    """The scene of a trajectory file that is to be explained.

    name    which one, where the file holds several
    raises  UserError for a file that cannot be used
    """
    known = scene_names(path)
    if name is None and len(known) > 1:
        raise UserError(
            f"{path}: holds {len(known)} scenes; accepted: observation.scene= one of {', '.join(known[:20])}"
        )
    record = read_scenes(path, [name or known[0]], with_keyframes=False)[0]
    if record.material != material:
        raise UserError(f"{record.label}: was observed of material '{record.material}'; accepted: {material}")
    return record


def from_record(
    record: SceneRecord, settings: SimulationSettings | None = None, body: PointCloud | None = None
) -> Observation:
    """A recorded scene as an observation: its particles are the markers.

    settings  to simulate with instead of the record's
    body      particles to simulate instead of the record's own, which then follow them as markers do
    """
    settings = settings or record.settings
    target = record.position.astype(np.float64)
    require_metres(target, record.label)
    _name_empty(record.label, target)
    check_record(replace(record, settings=settings))
    if body is None:
        name_contradictions([record])
    require_inside(record.position[0], record.settings, record.label, slack=0.5 * record.settings.grid_spacing)
    own = np.arange(target.shape[1])[:, None], np.ones((target.shape[1], 1))
    followed = own
    position, volume, affine = target[0], record.volume.astype(np.float64), record.initial_affine
    density = record.density
    velocity = None if record.initial_velocity is None else record.initial_velocity.astype(np.float64)
    if body is not None:
        names = [str(number) for number in range(target.shape[1])]
        followed = followed_particles(target[0], names, body.position, settings.grid_spacing)
        position, volume, velocity, density = body.position, body.volume, None, body.density
    affine = None if velocity is None or affine is None else affine.astype(np.float64)
    time = record.time - record.time[0]
    particle, weight = followed
    return Observation(
        record.name,
        record.material,
        settings,
        time=time,
        target=target,
        particle=particle,
        weight=weight,
        position=position,
        volume=volume,
        initial_velocity=velocity,
        truth=record.parameters,
        initial_affine=affine,
        density=density,
    )


def from_table(
    path: str | Path,
    material: str,
    settings: SimulationSettings,
    body: PointCloud,
    velocity_known: bool,
    capture: Capture | None = None,
) -> Observation:
    """The markers of a CSV or C3D file on a body of known shape, placed where they are in the first frame.

    body            the particles at time 0, the start of the simulation
    velocity_known  whether the body's velocities are those of the start
    capture         units, frame and clock of the file; None: metres (of a C3D file what it says), the simulation's
                    frame, time 0 is the start
    """
    time, names, target, registration = captured(Path(path), body.position, settings.grid_spacing, capture)
    require_metres(target, str(path), settings)
    first = target[0]
    placed = np.isfinite(first).all(1)
    if abs(time[0]) > AT_START or not placed.any():
        raise UserError(
            f"{path}: its first frame is at {time[0]:g} s with {int(placed.sum())} markers; accepted: time 0, the "
            "start, where each marker has its place on the body"
        )
    if not placed.all():
        log.warning(
            "%s: %d of %d markers were not seen at time 0, where each has its place on the body, and are not used",
            path,
            np.count_nonzero(~placed),
            len(placed),
        )
    names = [name for name, known in zip(names, placed, strict=True) if known]
    require_inside(body.position, settings, "scene")
    particle, weight = followed_particles(first[placed], names, body.position, settings.grid_spacing)
    _name_empty(str(path), target[:, placed])
    check_jumps(str(path), time, target[:, placed], names, body.position)
    check_motion(str(path), time, target[:, placed], settings, body.position)
    velocity = body.velocity if velocity_known else None
    return Observation(
        Path(path).stem,
        material,
        settings,
        time=time,
        target=target[:, placed],
        particle=particle,
        weight=weight,
        position=body.position,
        volume=body.volume,
        initial_velocity=velocity,
        truth={},
        initial_affine=body.affine if velocity_known else None,
        density=body.density,
        registration=None if registration is None else registration.plain(),
    )


def require_metres(
    target: Float[np.ndarray, "*observed 3"], where: str, settings: SimulationSettings | None = None
) -> None:
    """Refuses positions far beyond the domain, the unit box unless `settings` say another."""
    seen = target[np.isfinite(target)]
    if not len(seen):
        raise UserError(f"{where}: no position was observed, all are NaN; accepted: at least one")
    domain = UNIT_BOX if settings is None else settings.domain
    if domain is None:
        return
    low, high = min(domain[0]), max(domain[1])
    if seen.min() < low - BEYOND or seen.max() > high + BEYOND:
        far = seen[np.argmax(np.abs(seen - 0.5 * (low + high)))]
        size = f"{high - low:g} m" if domain == UNIT_BOX else f"{low:g} to {high:g} m"
        raise UserError(
            f"{where}: holds the coordinate {far:.4g}, far beyond the domain of {size}; metres expected"
            f"{length_hint(seen) if domain == UNIT_BOX else ''}"
        )


def write_table(
    path: str | Path,
    time: Float[np.ndarray, " frames"],
    names: Sequence[str],
    position: Float[np.ndarray, "frames markers 3"],
    digits: int = SINGLE_DIGITS,
) -> None:
    """Writes markers as a CSV file that from_table reads; NaN where one was not seen.

    digits  of the coordinates
    """
    time_digits = max(digits, TIME_DIGITS)
    with replaced_file(path) as unfinished:
        text = io.StringIO(newline="")
        rows = csv.writer(text)
        rows.writerow(COLUMNS)
        for t, frame in zip(time.tolist(), position.tolist(), strict=True):
            for name, coordinates in zip(names, frame, strict=True):
                cells = ("" if math.isnan(x) else f"{x:.{digits}g}" for x in coordinates)
                rows.writerow((f"{t:.{time_digits}g}", name, *cells))
        unfinished.write(text.getvalue().encode())


def _name_empty(where: str, target: Float[np.ndarray, "frames markers 3"]) -> None:
    empty = np.count_nonzero(np.isnan(target).all((1, 2)))
    if empty:
        log.warning("%s: %d of %d frames show nothing and are not used", where, empty, len(target))


def stored_truth(observation: Observation, names: tuple[str, ...]) -> Mapping[str, float]:
    """The parameters that the file stores, of those that are sought."""
    return {name: observation.truth[name] for name in names if name in observation.truth}
