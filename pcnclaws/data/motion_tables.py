"""A recorded motion as a CSV table: a line for each particle of each frame."""

import warnings
from pathlib import Path
from typing import Any

import numpy as np

from pcnclaws.atomic import replaced_file
from pcnclaws.data.frame_records import Frame, checked_fields, joined_components, name_unread, record_of
from pcnclaws.data.observation_files import DOUBLE_DIGITS, SINGLE_DIGITS, TIME_DIGITS
from pcnclaws.data.point_cloud_files import columns
from pcnclaws.data.room import require_room
from pcnclaws.data.scene_notes import notes_in_line
from pcnclaws.errors import UserError
from pcnclaws.simulation.particle_fields import ParticleFields
from pcnclaws.simulation.records import SceneRecord

PLACE = ("time", "x", "y", "z")
LONGEST_HEADER = 2**16
LARGEST_ID = 2.0**53  # of those that double precision tells apart


def write_motion_table(path: Path, fields: ParticleFields) -> None:
    """Writes the columns frame, time, id, x, y, z and the other fields of the particles, in SI units.

    Components of vectors and tensors are numbered by rows, velocity_0, ...; particles that were not observed in a frame
    have no line there.
    """
    record = fields.record
    digits = DOUBLE_DIGITS if record.position.dtype == np.float64 else SINGLE_DIGITS
    names = [name for name in (*fields.fixed, *fields.moving) if name != "id"]
    with replaced_file(path) as unfinished:
        for frame, time in enumerate(record.time.tolist()):
            seen = fields.seen(frame)
            table = columns(fields.at(frame, names), len(record.volume))
            if frame == 0:
                unfinished.write((",".join(("frame", "time", "id", "x", "y", "z", *table)) + "\n").encode())
            numbers = [record.position[frame], *(one[:, None] for one in table.values())]
            row = f"{frame},{time:.{max(digits, TIME_DIGITS)}g},%d" + f",%.{digits}g" * (3 + len(table)) + "\n"
            rows = np.concatenate([one.astype(np.float64) for one in numbers], axis=1)[seen].tolist()
            ids = np.flatnonzero(seen).tolist()
            unfinished.write("".join(row % (number, *cells) for number, cells in zip(ids, rows, strict=True)).encode())


def read_motion_table(path: Path, material: str) -> SceneRecord:
    """The scene of a CSV table with the columns time [s], x, y, z [m] and a line for each particle of each time.

    Optional are id, without which the particles have the same order at each time, volume, velocity_0 to velocity_2,
    density and physical parameters; what else it holds is named. Lines before the header that begin with # may be the
    notes of a scene, as in the header of a PLY file.
    raises  UserError, one line, for whatever is wrong with the file
    """
    if not path.is_file():
        raise UserError(f"{path}: no such file")
    require_room(8 * path.stat().st_size, str(path))
    names, notes, skipped = _header(path)
    for name in PLACE:
        if name not in names:
            raise UserError(
                f"{path}: the column '{name}' is missing; accepted: time, x, y, z, a line for each particle"
            )
    if len(set(names)) < len(names):
        raise UserError(f"{path}: a column is there twice; accepted: each once")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of a table without lines, which is refused below
            numbers = np.loadtxt(path, delimiter=",", skiprows=skipped, ndmin=2, encoding="utf-8-sig")
    except (ValueError, UnicodeDecodeError):
        raise UserError(f"{path}: a line does not hold {len(names)} numbers; accepted: numbers with commas") from None
    if not len(numbers) or numbers.shape[1] != len(names):
        raise UserError(f"{path}: holds no line of {len(names)} numbers; accepted: numbers with commas between them")
    table = dict(zip(names, numbers.T, strict=True))
    fields = joined_components(table)
    name_unread(path, [name for name in fields if name not in (*PLACE, "frame")])
    return record_of(_frames(table, fields, notes, str(path)), path, path.stem, material)


def _header(path: Path) -> tuple[list[str], dict[str, Any], int]:
    """The names of the columns, the notes of the scene before them, and how many lines both take."""
    notes: dict[str, Any] = {}
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        for number in range(1, LONGEST_HEADER):
            line = file.readline(LONGEST_HEADER)
            if not line.startswith("#"):
                return [name.strip().strip('"') for name in line.split(",")], notes, number
            notes |= notes_in_line(line.lstrip("# ").rstrip(), str(path))
    raise UserError(f"{path}: has no header; accepted: a line such as time,id,x,y,z")


def _frames(
    table: dict[str, np.ndarray], fields: dict[str, np.ndarray], notes: dict[str, Any], where: str
) -> list[Frame]:
    """The lines of each time as a frame."""
    if not np.isfinite(table["time"]).all():
        raise UserError(f"{where}: 'time' holds numbers that are not finite")
    if "id" in table and not np.all(np.abs(table["id"]) < LARGEST_ID):
        raise UserError(f"{where}: 'id' holds something that is no number of a particle; accepted: whole numbers")
    times, of_time = np.unique(table["time"], return_inverse=True)
    order = np.lexsort((table.get("id", np.zeros(len(of_time))), of_time))
    lines = np.split(order, np.cumsum(np.bincount(of_time))[:-1])
    position = np.stack([table[name] for name in "xyz"], axis=1)
    frames = []
    for time, chosen in zip(times.tolist(), lines, strict=True):
        own = {name: values[chosen] for name, values in fields.items()}
        frames.append(Frame(time, position[chosen], checked_fields(own, len(chosen), where), notes))
    return frames
