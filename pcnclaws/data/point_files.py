"""Point files: bodies from an .npz, a PLY point cloud or the first frame of a trajectory file."""

import logging
from pathlib import Path

import numpy as np

from pcnclaws.data.first_motion import name_contradictions
from pcnclaws.data.frame_records import name_unread
from pcnclaws.data.guarded_npz import opened_arrays
from pcnclaws.data.hdf5 import read_scenes, scene_names
from pcnclaws.data.ply_series import read_ply
from pcnclaws.data.units import check_spacing
from pcnclaws.errors import UserError
from pcnclaws.geometry.shapes import PointCloud
from pcnclaws.simulation.records import SceneRecord

log = logging.getLogger(__name__)

POINT_FILES = (".npz", ".ply", ".h5", ".hdf5")
# Arrays of an .npz and the shapes of what they hold of a particle.
ARRAYS: dict[str, tuple[int, ...]] = {"position": (3,), "velocity": (3,), "volume": (), "density": ()}
REQUIRED = ("position", "velocity", "volume")
LISTED = 8


def read_point_file(path: str | Path, name: str | None = None) -> PointCloud:
    """The body of a point file: an .npz of position, velocity and volume, a PLY point cloud with a volume for each
    vertex and, optionally, velocity_0, ..., or the first frame of a trajectory file.

    All may hold the density of each particle. Other arrays of an .npz and other properties are named in one line.

    name    the scene of a trajectory file that holds several
    raises  UserError, one line, for whatever is wrong with the file
    """
    path = Path(path)
    if path.suffix.lower() not in POINT_FILES:
        raise UserError(f"scene.particles={path} is not accepted; accepted: a file ending in {', '.join(POINT_FILES)}")
    if not path.is_file():
        raise UserError(f"scene.particles={path}: no such file")
    if path.suffix.lower() == ".npz":
        return _checked(path, _arrays(path))
    return _read_ply(path) if path.suffix.lower() == ".ply" else _first_frame(path, name)


def read_one_scene(path: Path, name: str | None) -> SceneRecord:
    """The scene of a trajectory file of that name, or the only one."""
    known = scene_names(path)
    if name is None and len(known) > 1:
        raise UserError(f"{path}: holds {len(known)} scenes; accepted: scene.name= one of {', '.join(known[:20])}")
    return read_scenes(path, [name if name is not None else known[0]])[0]


def _first_frame(path: Path, name: str | None) -> PointCloud:
    record = read_one_scene(path, name)
    name_contradictions([record])
    check_spacing(record.label, record.position[0], record.volume)
    if record.initial_velocity is None:
        raise UserError(f"{record.label}: has no initial_velocity; a scene cannot start from it")
    start, keyframes = record.position[0], record.keyframes
    body = PointCloud(
        start.astype(np.float64),
        record.initial_velocity.astype(np.float64),
        record.volume.astype(np.float64),
        density=None if record.density is None else record.density.astype(np.float64),
    )
    if keyframes is None or keyframes.step[0] != 0:
        affine = record.initial_affine
        return body if affine is None else body._replace(affine=affine.astype(np.float64))
    return body._replace(
        affine=keyframes.affine[0].astype(np.float64),
        deformation=keyframes.deformation[0].astype(np.float64),
        internal={name: values[0].astype(np.float64) for name, values in keyframes.internal.items()},
    )


def _read_ply(path: Path) -> PointCloud:
    cloud = read_ply(path)
    if "volume" not in cloud.fields:
        raise UserError(f"{path}: the property 'volume' is missing; accepted: x, y, z and volume of each vertex")
    arrays = {"position": cloud.position, "velocity": np.zeros_like(cloud.position), **cloud.fields}
    name_unread(path, [*cloud.unread, *(name for name in cloud.fields if name not in ARRAYS)], ARRAYS)
    return _checked(path, {name: arrays[name].astype(np.float64) for name in ARRAYS if name in arrays})


def _checked(path: Path, arrays: dict[str, np.ndarray]) -> PointCloud:
    position, volume = arrays["position"], arrays["volume"]
    count = position.shape[0] if position.ndim else 0
    for name, values in arrays.items():
        if values.shape != (count, *ARRAYS[name]):
            accepted = "(N, 3)" if ARRAYS[name] else "(N,)"
            raise UserError(f"{path}: '{name}' has the shape {values.shape}; accepted: {accepted}, the same N for all")
        if not np.isfinite(values).all():
            raise UserError(f"{path}: '{name}' holds numbers that are not finite")
    if count == 0:
        raise UserError(f"{path}: holds no particle")
    for name in ("volume", "density"):
        if name in arrays and arrays[name].min() <= 0.0:
            raise UserError(f"{path}: '{name}' is not positive everywhere")
    check_spacing(str(path), position, volume)
    return PointCloud(position, arrays["velocity"], volume, density=arrays.get("density"))


def _arrays(path: Path) -> dict[str, np.ndarray]:
    """Those of ARRAYS in double precision. Objects are refused: reading one would run code from the file."""
    with opened_arrays(path) as file:
        for name in REQUIRED:
            if name not in file:
                raise UserError(f"{path}: '{name}' is missing; accepted: position (N, 3), velocity (N, 3), volume (N,)")
        arrays = {name: file[name] for name in ARRAYS if name in file}
        others = [name if name.isprintable() else ascii(name) for name in file if name not in ARRAYS]
    if others:
        log.warning(
            "%s: not read: %s; read: %s", path, ", ".join(name[:60] for name in others[:LISTED]), ", ".join(ARRAYS)
        )
    for name, values in arrays.items():
        if values.dtype.kind not in "fiu":
            raise UserError(f"{path}: '{name}' holds {values.dtype}; accepted: numbers")
    return {name: values.astype(np.float64) for name, values in arrays.items()}
