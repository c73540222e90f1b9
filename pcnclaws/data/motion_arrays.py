"""Trajectories from an .npz of arrays, such as Motion.save writes."""

from pathlib import Path

import numpy as np

from pcnclaws.data.frame_records import READ, Frame, checked_fields, name_unread, record_of
from pcnclaws.data.guarded_npz import opened_arrays
from pcnclaws.data.scene_notes import SETTINGS
from pcnclaws.errors import UserError
from pcnclaws.laws.parameters import PARAMETERS
from pcnclaws.simulation.records import SceneRecord

WORDS = ("name", "material", "boundary", "transfer")
LONGEST_WORD, LAST_LETTER = 100, 0x110000
# Arrays that are the same in all frames.
FIXED = tuple(name for name in READ if name != "velocity" and name not in PARAMETERS)


def read_motion_arrays(path: Path, material: str) -> SceneRecord:
    """The scene of an .npz: time (frames,) [s], position (frames, particles, 3) [m].

    Optional are volume (particles,) [m^3], velocity (frames, particles, 3), density and id (particles,), initial_affine
    (particles, 3, 3), physical parameters and settings as numbers, and the words material, name and boundary. What else
    it holds is named.
    raises  UserError, one line, for whatever is wrong with the file
    """
    with opened_arrays(path) as file:
        for name in ("time", "position"):
            if name not in file:
                raise UserError(f"{path}: '{name}' is missing; accepted: time (N,), position (N, particles, 3)")
        known = ("time", "position", *READ, *SETTINGS, *WORDS)
        arrays = {name: file[name] for name in known if name in file}
        others = [name for name in file if name not in known]
    time, position = arrays["time"], arrays["position"]
    if position.dtype.kind != "f" or position.ndim != 3 or position.shape[2] != 3 or time.shape != position.shape[:1]:
        raise UserError(
            f"{path}: 'position' has the shape {position.shape} and 'time' {time.shape}; accepted: (N, particles, 3) "
            "and (N,)"
        )
    if not len(time) or time.dtype.kind not in "fiu":
        raise UserError(f"{path}: holds no frame")
    name_unread(path, others)
    return record_of(_frames(path, arrays), path, path.stem, material)


def _frames(path: Path, arrays: dict[str, np.ndarray]) -> list[Frame]:
    where, position = str(path), arrays["position"]
    count = position.shape[1]
    fixed = {name: arrays[name] for name in FIXED if name in arrays}
    fixed |= {name: arrays[name] for name in PARAMETERS if name in arrays and arrays[name].ndim}
    fixed = checked_fields(fixed, count, where)
    notes = {name: arrays[name] for name in (*SETTINGS, *PARAMETERS) if name in arrays and name not in fixed}
    notes |= {name: _word(arrays[name], name, where) for name in WORDS if name in arrays}
    notes.pop("density", None)
    velocity = arrays.get("velocity")
    if velocity is not None and velocity.shape != position.shape:
        raise UserError(f"{path}: 'velocity' has the shape {velocity.shape}; accepted: {position.shape}")
    frames = []
    for k, time in enumerate(arrays["time"].tolist()):
        fields = fixed if velocity is None else fixed | checked_fields({"velocity": velocity[k]}, count, where)
        frames.append(Frame(float(time), position[k].astype(_kind(position)), fields, notes))
    return frames


def _word(values: np.ndarray, name: str, where: str) -> str:
    """A text of one line. NumPy makes texts of whatever numbers the file holds, which Python then trips over."""
    codes = np.ascontiguousarray(values).view(np.uint32) if values.dtype.kind == "U" and values.size == 1 else None
    word = str(values) if codes is not None and (codes < LAST_LETTER).all() else ""
    if not word.isprintable() or not 0 < len(word) <= LONGEST_WORD:
        raise UserError(f"{where}: '{name}' is not a text of one line; accepted: up to {LONGEST_WORD} letters")
    return word


def _kind(values: np.ndarray) -> type:
    return np.float64 if values.dtype == np.float64 else np.float32
