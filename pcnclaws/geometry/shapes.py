"""Bodies as particles: a named shape or a mesh. Particle-first, double precision."""

import logging
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from pcnclaws.errors import UserError, unknown_name
from pcnclaws.geometry.implicit_shapes import BODIES, FEWEST_PER_EDGE, filled_body, volume_fraction
from pcnclaws.geometry.lattices import LATTICES, lattice_points
from pcnclaws.geometry.meshes import ClosedSurface, filled_surface, read_surface

log = logging.getLogger(__name__)

SHAPES = ("cube", "sphere", *BODIES)
MAXIMUM_PARTICLES_PER_EDGE = 200


class PointCloud(NamedTuple):
    """A body as particles.

    position     [m], (particles, 3)
    velocity     [m/s], (particles, 3)
    volume       initial volume [m^3], (particles,)
    affine       APIC velocity gradient C [1/s], (particles, 3, 3), None for 0
    deformation  elastic deformation gradient F [-], (particles, 3, 3), None for I
    density      [kg/m^3], (particles,), None where it is that of the settings
    internal     internal variables by name, each (particles,), those of an undeformed body where they are missing
    """

    position: Float[np.ndarray, "particles 3"]
    velocity: Float[np.ndarray, "particles 3"]
    volume: Float[np.ndarray, " particles"]
    affine: Float[np.ndarray, "particles 3 3"] | None = None
    deformation: Float[np.ndarray, "particles 3 3"] | None = None
    density: Float[np.ndarray, " particles"] | None = None
    internal: Mapping[str, Float[np.ndarray, " particles"]] = MappingProxyType({})


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
    return surface_particles(read_surface(path), centre, side, particles_per_edge, lattice)


def surface_particles(
    surface: ClosedSurface,
    centre: Sequence[float | int],
    side: float | int,
    particles_per_edge: int,
    lattice: str,
) -> PointCloud:
    """As mesh_particles, for a surface that is read already."""
    _check_lattice(centre, side, particles_per_edge, lattice)
    return _placed(*filled_surface(surface, particles_per_edge, lattice), centre, side)


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
    if not (math.isfinite(side) and side > 0.0):
        raise UserError(f"scene.side={side} is not accepted; accepted: above 0 m")
    if not 2 <= particles_per_edge <= MAXIMUM_PARTICLES_PER_EDGE or particles_per_edge != int(particles_per_edge):
        raise UserError(
            f"scene.particles_per_edge={particles_per_edge} is not accepted; "
            f"accepted: a whole number from 2 to {MAXIMUM_PARTICLES_PER_EDGE}"
        )
