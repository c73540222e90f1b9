"""A recorded motion as a file of the format that its ending names."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from pcnclaws.atomic import replaced_file
from pcnclaws.data.hdf5 import write_scenes
from pcnclaws.data.point_cloud_files import write_ply, write_pvd, write_vtu
from pcnclaws.errors import UserError
from pcnclaws.simulation.records import SceneRecord

# What the names of internal variables begin with, beside those of other arrays.
INTERNAL = "internal_"


def write_motion(path: Path, record: SceneRecord, frame: int) -> None:
    """Writes a motion, whole or not at all; folders above it are made.

    .h5 .hdf5    the trajectory file
    .npz         arrays of NumPy
    .pvd         a ParaView collection of all frames, each a .vtu file beside it
    .ply .vtu    one frame

    frame   the one that goes into a format of one frame, counted from the end where it is negative
    raises  UserError for another ending, for a frame that does not exist and for a path that cannot be written
    """
    count = len(record.time)
    if not -count <= frame < count:
        raise UserError(f"frame={frame} does not exist; accepted: {-count} to {count - 1}")
    WRITERS[path.suffix.lower()](path, record, frame)


def _trajectory(path: Path, record: SceneRecord, frame: int) -> None:
    write_scenes(path, [record])


def _arrays(path: Path, record: SceneRecord, frame: int) -> None:
    whole = {"time": record.time, "position": record.position, "volume": record.volume}
    states = record.states_at_frames
    optional = {
        "velocity": record.velocity,
        "deformation": None if states is None else states.deformation,
        "density": record.density,
        "impulses": record.impulses,
    }
    arrays = whole | {name: values for name, values in optional.items() if values is not None}
    arrays |= {} if states is None else {f"{INTERNAL}{name}": values for name, values in states.internal.items()}
    arrays |= {name: np.array(value) for name, value in record.parameters.items()}
    with replaced_file(path) as part:
        np.savez_compressed(part, material=np.array(record.material), **arrays)  # pyright: ignore[reportArgumentType]


def _ply(path: Path, record: SceneRecord, frame: int) -> None:
    write_ply(path, record.position[frame], _fields(record, frame))


def _vtu(path: Path, record: SceneRecord, frame: int) -> None:
    write_vtu(path, record.position[frame], _fields(record, frame))


def _collection(path: Path, record: SceneRecord, frame: int) -> None:
    digits = len(str(len(record.time) - 1))
    files = [path.with_name(f"{path.stem}_{k:0{digits}d}.vtu") for k in range(len(record.time))]
    for k, file in enumerate(files):
        _vtu(file, record, k)
    write_pvd(path, record.time.tolist(), [file.name for file in files])


def _fields(record: SceneRecord, frame: int) -> dict[str, np.ndarray]:
    states = record.states_at_frames
    fields = {
        "velocity": None if record.velocity is None else record.velocity[frame],
        "volume": record.volume,
        "density": record.density,
        "deformation": None if states is None else states.deformation[frame],
    }
    fields |= {} if states is None else {f"{INTERNAL}{name}": values[frame] for name, values in states.internal.items()}
    return {name: values for name, values in fields.items() if values is not None}


WRITERS: dict[str, Callable[[Path, SceneRecord, int], None]] = {
    ".h5": _trajectory,
    ".hdf5": _trajectory,
    ".npz": _arrays,
    ".ply": _ply,
    ".vtu": _vtu,
    ".pvd": _collection,
}
