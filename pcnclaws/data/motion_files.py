"""A recorded motion as files of the format that an ending names."""

import logging
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pcnclaws.atomic import replaced_file
from pcnclaws.data.hdf5 import write_scenes
from pcnclaws.data.motion_tables import write_motion_table
from pcnclaws.data.point_cloud_files import write_ply, write_pvd, write_vtu
from pcnclaws.data.scene_notes import line_of, notes_of
from pcnclaws.data.usd_files import require_usd, write_usd
from pcnclaws.errors import UserError
from pcnclaws.simulation.particle_fields import ParticleFields

log = logging.getLogger(__name__)


class Format(NamedTuple):
    """A format of motions.

    write        all frames of the motion to a path; the files that were written
    write_frame  one frame, None where a file holds all of them
    """

    write: Callable[[Path, ParticleFields], list[Path]]
    write_frame: Callable[[Path, ParticleFields, int], None] | None = None
    is_derived: bool = True
    require: Callable[[], object] = lambda: None


def write_motion(path: Path, fields: ParticleFields, frame: int | None = None) -> list[Path]:
    """Writes a motion, each file whole or not at all, and returns the files; folders above them are made.

    .h5 .hdf5         the trajectory file
    .npz              arrays of NumPy
    .csv              a table, a line for each particle of each frame
    .pvd              a ParaView collection of all frames, each a .vtu file beside it
    .vtu .ply         one frame, or a file for each: NAME_000.ply, ...; with .vtu files goes their collection
    .usd .usda .usdc  points of Universal Scene Description, with a time sample for each frame

    What the file could hold, but the motion does not, is named in one line.
    frame   the one that goes into a format of one frame, counted from the end where it is negative; None: all
    raises  UserError for another ending, for a frame that does not exist and for a path that cannot be written
    """
    chosen_frames(path, len(fields.record.time), frame)
    chosen = FORMATS[path.suffix.lower()]
    chosen.require()
    if chosen.is_derived:
        _name_missing(path, fields)
    if frame is None or chosen.write_frame is None:
        return chosen.write(path, fields)
    chosen.write_frame(path, fields, frame)
    return [path]


def chosen_frames(path: Path, count: int, frame: int | None) -> dict[int, Path]:
    """The frames of a series, and the file of each: NAME_000.ply, ... of all, `path` itself of one.

    frame   the one, counted from the end where it is negative; None: all
    raises  UserError for a frame that does not exist
    """
    if frame is None:
        return dict(enumerate(_numbered(path, count)))
    if not -count <= frame < count:
        raise UserError(f"frame={frame} does not exist; accepted: {-count} to {count - 1}")
    return {frame: path}


def _name_missing(path: Path, fields: ParticleFields) -> None:
    """One line for what the file does not hold, with the reasons."""
    reasons: dict[str, list[str]] = {}
    for name, why in fields.missing.items():
        reasons.setdefault(why, []).append(name)
    settings = fields.record.settings
    for name, things in (("colliders", settings.colliders), ("loads", settings.loads)):
        if things:
            reasons.setdefault("the format has no place for them", []).append(name)
    if reasons:
        words = "; ".join(f"{', '.join(names)}: {why}" for why, names in reasons.items())
        log.warning("%s: not part of the file: %s", path, words)


def _trajectory(path: Path, fields: ParticleFields) -> list[Path]:
    write_scenes(path, [fields.record])
    return [path]


def _arrays(path: Path, fields: ParticleFields) -> list[Path]:
    record = fields.record
    arrays = {"time": record.time, "position": record.position}
    arrays |= {name: np.stack([fields.at(k, [name])[name] for k in range(len(record.time))]) for name in fields.moving}
    arrays |= {} if record.impulses is None else {"impulses": record.impulses}
    each = {name: values for name, values in fields.fixed.items() if name not in record.parameters}
    notes = {
        name: np.array(value) for name, value in notes_of(record).items() if name not in each and value is not None
    }
    with replaced_file(path) as part:
        np.savez_compressed(part, **(arrays | each | notes))  # pyright: ignore[reportArgumentType]
    return [path]


def _table(path: Path, fields: ParticleFields) -> list[Path]:
    write_motion_table(path, fields)
    return [path]


def _scene_description(path: Path, fields: ParticleFields) -> list[Path]:
    write_usd(path, fields)
    return [path]


def _ply(path: Path, fields: ParticleFields, frame: int) -> None:
    write_ply(path, *_seen(fields, frame))


def _vtu(path: Path, fields: ParticleFields, frame: int) -> None:
    write_vtu(path, *_seen(fields, frame))


def _seen(fields: ParticleFields, frame: int) -> tuple[np.ndarray, dict[str, np.ndarray], str]:
    """Positions and fields of the particles that were observed in a frame, and what is said of the scene."""
    seen = fields.seen(frame)
    values = {name: one[seen] for name, one in fields.at(frame).items()}
    notes = {"time": float(fields.record.time[frame])} | notes_of(fields.record)
    return fields.record.position[frame][seen], values, line_of(notes)


def _ply_series(path: Path, fields: ParticleFields) -> list[Path]:
    files = _numbered(path, len(fields.record.time))
    for k, file in enumerate(files):
        _ply(file, fields, k)
    return files


def _collection(path: Path, fields: ParticleFields) -> list[Path]:
    files = _numbered(path.with_suffix(".vtu"), len(fields.record.time))
    for k, file in enumerate(files):
        _vtu(file, fields, k)
    collection = path.with_suffix(".pvd")
    write_pvd(collection, fields.record.time.tolist(), [file.name for file in files])
    return [collection, *files]


def _numbered(path: Path, count: int) -> list[Path]:
    digits = len(str(count - 1))
    return [path.with_name(f"{path.stem}_{k:0{digits}d}{path.suffix}") for k in range(count)]


USD = Format(_scene_description, require=require_usd)
FORMATS: dict[str, Format] = {
    ".h5": Format(_trajectory, is_derived=False),
    ".hdf5": Format(_trajectory, is_derived=False),
    ".npz": Format(_arrays),
    ".csv": Format(_table),
    ".ply": Format(_ply_series, _ply),
    ".vtu": Format(_collection, _vtu),
    ".pvd": Format(_collection),
    ".usd": USD,
    ".usda": USD,
    ".usdc": USD,
}
