"""Bodies as particles: a named shape, a mesh, or whatever a point file holds. Particle-first, double precision."""

import logging
import math
import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from pcnclaws.data.bodies import BODIES, FEWEST_PER_EDGE, filled_body, volume_fraction
from pcnclaws.data.first_motion import name_contradictions
from pcnclaws.data.hdf5 import read_scenes, scene_names
from pcnclaws.data.lattices import LATTICES, lattice_points
from pcnclaws.data.meshes import filled_mesh
from pcnclaws.data.records import LARGEST_VOLUME
from pcnclaws.data.units import check_spacing
from pcnclaws.errors import UserError, unknown_name

log = logging.getLogger(__name__)

SHAPES = ("cube", "sphere", *BODIES)
POINT_FILES = (".npz", ".h5", ".hdf5")
# Arrays of an .npz and the shapes of what they hold of a particle.
ARRAYS: dict[str, tuple[int, ...]] = {"position": (3,), "velocity": (3,), "volume": (), "density": ()}
REQUIRED = ("position", "velocity", "volume")
LISTED = 8
MAXIMUM_PARTICLES_PER_EDGE = 200
MAXIMUM_POINT_FILE_BYTES = 4 * 1024**3


class PointCloud(NamedTuple):
    """A body as particles.

    position     [m], (particles, 3)
    velocity     [m/s], (particles, 3)
    volume       initial volume [m^3], (particles,)
    affine       APIC velocity gradient C [1/s], (particles, 3, 3), None for 0
    deformation  elastic deformation gradient F [-], (particles, 3, 3), None for I
    density      [kg/m^3], (particles,), None where it is that of the settings
    """

    position: Float[np.ndarray, "particles 3"]
    velocity: Float[np.ndarray, "particles 3"]
    volume: Float[np.ndarray, " particles"]
    affine: Float[np.ndarray, "particles 3 3"] | None = None
    deformation: Float[np.ndarray, "particles 3 3"] | None = None
    density: Float[np.ndarray, " particles"] | None = None


def particles(
    shape: str = "cube",
    centre: Sequence[float | int] = (0.5, 0.5, 0.5),
    side: float | int = 0.5,
    particles_per_edge: int = 10,
    lattice: str = "faces",
) -> PointCloud:
    """A shape at rest, filled with a uniform lattice of particles of equal volume.

    shape    'cube'; 'sphere': the points of the cube's lattice that lie in the sphere; one of BODIES: the centres of
             cells of the box that lie in the body, whatever the lattice
    centre   of the shape's box [m]
    side     edge of the cube, diameter of the sphere, edge of the box that a body is defined in [m]
    lattice  of the cube, one of LATTICES; the default is that of the paper and of its data
    raises   UserError
    """
    _check_shape(shape, centre, side, particles_per_edge, lattice)
    return _placed(*_unit_lattice(shape, particles_per_edge, lattice), centre, side)


def mesh_particles(
    path: str | Path,
    centre: Sequence[float | int] = (0.5, 0.5, 0.5),
    side: float | int = 0.5,
    particles_per_edge: int = 10,
    lattice: str = "faces",
) -> PointCloud:
    """The body inside of a watertight surface mesh at rest: particles of equal volume on the cube's lattice.

    path                of a file that trimesh reads, in any unit of length
    centre              of the mesh's bounding box [m]
    side                longest edge of the bounding box [m]
    particles_per_edge  along the longest edge
    lattice             one of LATTICES
    raises              UserError
    """
    _check_lattice(centre, side, particles_per_edge, lattice)
    return _placed(*filled_mesh(path, particles_per_edge, lattice), centre, side)


def spin_velocity(
    position: Float[np.ndarray, "particles 3"],
    velocity: Float[np.ndarray, "particles 3"],
    spin: Sequence[float | int],
    centre: Sequence[float | int] | None = None,
) -> Float[np.ndarray, "particles 3"]:
    """Velocities with a rigid rotation added: v + spin x (x - centre) [m/s], (particles, 3).

    spin    [rad/s]
    centre  [m], None for the mean of the positions
    """
    middle = position.mean(0) if centre is None else np.asarray(centre, dtype=np.float64)
    return velocity + np.cross(np.asarray(spin, dtype=np.float64), position - middle)


def read_point_file(path: str | Path, name: str | None = None) -> PointCloud:
    """The body of a point file: an .npz of position, velocity and volume, or the first frame of a trajectory file.

    Both may hold the density of each particle. Other arrays of an .npz are named in one line.

    name    the scene of a trajectory file that holds several
    raises  UserError, one line, for whatever is wrong with the file
    """
    path = Path(path)
    if path.suffix.lower() not in POINT_FILES:
        raise UserError(f"scene.particles={path} is not accepted; accepted: a file ending in {', '.join(POINT_FILES)}")
    if not path.is_file():
        raise UserError(f"scene.particles={path}: no such file")
    return _read_npz(path) if path.suffix.lower() == ".npz" else _first_frame(path, name)


def _unit_lattice(shape: str, per_edge: int, lattice: str) -> tuple[Float[np.ndarray, "particles 3"], float]:
    """The points of a shape of side 1 about the origin, and its volume."""
    if shape in BODIES:
        return filled_body(shape, per_edge), volume_fraction(shape)
    along = lattice_points(1.0, per_edge, lattice)
    points = np.stack(np.meshgrid(along, along, along, indexing="ij"), axis=-1).reshape(-1, 3)
    if shape == "cube":
        return points, 1.0
    # the tolerance keeps points that lie on the sphere but for rounding
    return points[np.square(points).sum(1) <= 0.25 * (1.0 + 1e-9)], math.pi / 6.0


def _placed(
    lattice: Float[np.ndarray, "particles 3"], fraction: float, centre: Sequence[float | int], side: float | int
) -> PointCloud:
    """The body of a lattice about the origin and its volume, both in units of a side that becomes `side` [m]."""
    count = len(lattice)
    position = np.asarray(centre, dtype=np.float64) + side * lattice
    return PointCloud(position, np.zeros_like(position), np.full(count, fraction * side**3 / count))


def _check_shape(
    shape: str, centre: Sequence[float | int], side: float | int, particles_per_edge: int, lattice: str
) -> None:
    if shape not in SHAPES:
        raise unknown_name("scene.shape", shape, SHAPES)
    _check_lattice(centre, side, particles_per_edge, lattice)
    fewest = FEWEST_PER_EDGE if shape in BODIES else 3 if shape == "sphere" else 2
    if particles_per_edge < fewest:
        raise UserError(
            f"scene.particles_per_edge={particles_per_edge} is too coarse for scene.shape={shape}; "
            f"accepted: from {fewest}"
        )


def _check_lattice(centre: Sequence[float | int], side: float | int, particles_per_edge: int, lattice: str) -> None:
    if lattice not in LATTICES:
        raise unknown_name("scene.lattice", lattice, LATTICES)
    if len(centre) != 3 or not np.isfinite(np.asarray(centre, dtype=np.float64)).all():
        raise UserError(f"scene.centre={list(centre)} is not accepted; accepted: three finite numbers [m]")
    if not (math.isfinite(side) and 0.0 < side <= 1.0):
        raise UserError(f"scene.side={side} is not accepted; accepted: above 0 to 1 m")
    if not 2 <= particles_per_edge <= MAXIMUM_PARTICLES_PER_EDGE or particles_per_edge != int(particles_per_edge):
        raise UserError(
            f"scene.particles_per_edge={particles_per_edge} is not accepted; "
            f"accepted: a whole number from 2 to {MAXIMUM_PARTICLES_PER_EDGE}"
        )


def _first_frame(path: Path, name: str | None) -> PointCloud:
    known = scene_names(path)
    if name is None and len(known) > 1:
        raise UserError(f"{path}: holds {len(known)} scenes; accepted: scene.name= one of {', '.join(known[:20])}")
    record = read_scenes(path, [name if name is not None else known[0]])[0]
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
        affine=keyframes.affine[0].astype(np.float64), deformation=keyframes.deformation[0].astype(np.float64)
    )


def _read_npz(path: Path) -> PointCloud:
    try:
        arrays = _arrays(path)
    except UserError:
        raise
    except (
        OSError,
        ValueError,
        EOFError,
        KeyError,
        TypeError,
        MemoryError,
        NotImplementedError,
        RuntimeError,
        zipfile.BadZipFile,
        zlib.error,
    ) as error:
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise UserError(f"{path}: not an .npz file of numbers, or damaged ({reason})") from error
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
    if volume.sum() > LARGEST_VOLUME:
        raise UserError(
            f"{path}: 'volume' sums to {volume.sum():.3g}, more than the domain holds; accepted: m^3, at most 1"
        )
    check_spacing(str(path), position, volume)
    return PointCloud(**arrays)


def _arrays(path: Path) -> dict[str, np.ndarray]:
    """Those of ARRAYS in double precision. Objects are refused: reading one would run code from the file."""
    with zipfile.ZipFile(path) as archive:
        if sum(member.file_size for member in archive.infolist()) > MAXIMUM_POINT_FILE_BYTES:
            raise UserError(f"{path}: claims more than {MAXIMUM_POINT_FILE_BYTES / 1024**3:g} GiB of points")
    with np.load(path, allow_pickle=False) as file:
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
