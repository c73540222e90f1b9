"""A recorded motion as a CSV table: a line for each particle of each frame."""

from pathlib import Path

import numpy as np

from pcnclaws.atomic import replaced_file
from pcnclaws.data.observation_files import DOUBLE_DIGITS, SINGLE_DIGITS, TIME_DIGITS
from pcnclaws.data.point_cloud_files import columns
from pcnclaws.simulation.particle_fields import ParticleFields


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
