"""Observations from files: a trajectory file of ours, or a table of markers.

time, marker, x, y, z        a CSV file with this header, in seconds and metres; an empty coordinate was not seen
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
from pcnclaws.data.markers import followed_particles
from pcnclaws.data.observation import Observation
from pcnclaws.data.units import check_motion, check_record
from pcnclaws.errors import UserError
from pcnclaws.geometry.shapes import PointCloud
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.simulation.placement import length_hint, require_inside
from pcnclaws.simulation.records import SceneRecord

log = logging.getLogger(__name__)

COLUMNS = ("time", "marker", "x", "y", "z")
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
    _require_metres(target, record.label)
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
    path: str | Path, material: str, settings: SimulationSettings, body: PointCloud, velocity_known: bool
) -> Observation:
    """The markers of a CSV file on a body of known shape, placed where they are in the first frame.

    body            the particles at time 0, the start of the simulation
    velocity_known  whether the body's velocities are those of the start
    """
    time, names, target = _read_table(Path(path))
    _require_metres(target, str(path))
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


def _read_table(path: Path) -> tuple[np.ndarray, list[str], Float[np.ndarray, "frames markers 3"]]:
    """Times, names of the markers in the order of the file, and positions."""
    if not path.is_file():
        raise UserError(f"{path}: no such file")
    places: dict[tuple[float, str], tuple[float, ...]] = {}
    with path.open(newline="", encoding="utf-8-sig", errors="replace") as file:
        rows = csv.DictReader(file)
        header = [str(name).strip() for name in rows.fieldnames or ()]
        missing = [name for name in COLUMNS if name not in header]
        if missing:
            raise UserError(f"{path}: the column '{missing[0]}' is missing; accepted: the header {','.join(COLUMNS)}")
        others = [name[:60] for name in header if name not in COLUMNS]
        if others:
            log.warning("%s: not read: the columns %s; read: %s", path, ", ".join(others), ", ".join(COLUMNS))
        if len(set(header)) < len(header):
            raise UserError(f"{path}: a column is there twice; accepted: the header {','.join(COLUMNS)}")
        for row in rows:
            values = {str(key).strip(): value for key, value in row.items()}
            time, *position = (_number(values[name], name, path, rows.line_num) for name in COLUMNS if name != "marker")
            if not math.isfinite(time):
                raise UserError(f"{path}: line {rows.line_num} has no time; accepted: seconds since the start")
            key = time, str(values["marker"]).strip()
            if key in places and not np.array_equal(places[key], position, equal_nan=True):
                raise UserError(
                    f"{path}: line {rows.line_num}: marker {_quoted(key[1])} has a second position at {time:g} s; "
                    "accepted: one for each time"
                )
            places[key] = tuple(position)
    if not places:
        raise UserError(f"{path}: holds no marker; accepted: lines of {','.join(COLUMNS)}")
    times, names = sorted({time for time, _ in places}), list(dict.fromkeys(name for _, name in places))
    lacking = [place for place in places.values() if 0 < sum(map(math.isfinite, place)) < len(place)]
    if lacking:
        log.warning("%s: %d positions lack a coordinate and are not used", path, len(lacking))
    target = np.full((len(times), len(names), 3), np.nan)
    frame, column = ({key: k for k, key in enumerate(keys)} for keys in (times, names))
    for (time, name), position in places.items():
        if all(map(math.isfinite, position)):
            target[frame[time], column[name]] = position
    return np.array(times), names, target


def _quoted(text: str) -> str:
    """The beginning of a cell, on one line."""
    return f"'{text[:40]}'" if text[:40].isprintable() else ascii(text[:40])


def _number(text: str | None, name: str, path: Path, line: int) -> float:
    """The number of a cell; NaN of an empty one."""
    if text is None or not text.strip():
        return math.nan
    try:
        return float(text)
    except ValueError:
        raise UserError(
            f"{path}: line {line}: {name}={_quoted(text)} is not a number; accepted: a number, or empty"
        ) from None


def _require_metres(target: Float[np.ndarray, "frames markers 3"], where: str) -> None:
    seen = target[np.isfinite(target)]
    if not len(seen):
        raise UserError(f"{where}: no position was observed, all are NaN; accepted: at least one")
    if seen.min() < -BEYOND or seen.max() > 1.0 + BEYOND:
        far = seen[np.argmax(np.abs(seen - 0.5))]
        raise UserError(
            f"{where}: holds the coordinate {far:.4g}, far beyond the domain of 1 m; metres expected{length_hint(seen)}"
        )


def _name_empty(where: str, target: Float[np.ndarray, "frames markers 3"]) -> None:
    empty = np.count_nonzero(np.isnan(target).all((1, 2)))
    if empty:
        log.warning("%s: %d of %d frames show nothing and are not used", where, empty, len(target))


def stored_truth(observation: Observation, names: tuple[str, ...]) -> Mapping[str, float]:
    """The parameters that the file stores, of those that are sought."""
    return {name: observation.truth[name] for name in names if name in observation.truth}
