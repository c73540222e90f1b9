"""Bodies from surface meshes: a file that trimesh reads, scaled to the unit box and filled with a lattice of particles.

The lattice is the cube's: `per_edge` points along the longest edge of the mesh's bounding box, its ends included, and
along the other edges as many of the same spacing as fit, centred.
"""

from pathlib import Path
from types import ModuleType
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from pcnclaws.data.winding import lattice_winding
from pcnclaws.errors import UserError

# A point this near to the surface, relative to its distance from the origin, is on it but for the single precision of
# most files.
ROUNDING = 1e-5
ACCEPTED = "accepted: a watertight surface mesh, such as an .stl, .obj, .ply, .off or .glb file"


class ClosedSurface(NamedTuple):
    """A watertight mesh. Its bounding box is about the origin and has a longest edge of 1.

    vertices  [-], (vertices, 3)
    faces     rows of `vertices`, counterclockwise seen from outside, (faces, 3)
    volume    what it encloses [-], 0 where it is flat
    """

    vertices: Float[np.ndarray, "vertices 3"]
    faces: Int[np.ndarray, "faces 3"]
    volume: float


def filled_mesh(path: str | Path, per_edge: int) -> tuple[Float[np.ndarray, "particles 3"], float]:
    """The lattice points inside of a mesh that is scaled to a longest edge of 1 about the origin, and its volume.

    Points on the surface count where it faces away from the origin, as the faces of a box do.
    raises  UserError, one line, for whatever is wrong with the file, and where no point lies inside
    """
    surface = read_surface(path)
    x, y, z = (_along(extent, per_edge) for extent in np.ptp(surface.vertices, axis=0))
    inwards = 1.0 - ROUNDING
    winding = lattice_winding(surface.vertices, surface.faces, inwards * x, inwards * y, inwards * z)
    if not np.isin(winding, (0, 1)).all():
        raise UserError(
            f"scene.mesh={path} overlaps with itself, or faces the wrong way around a cavity; "
            "accepted: parts that do not overlap, their faces counterclockwise seen from outside of the material"
        )
    i, j, k = np.nonzero(winding)
    if len(i) == 0:
        raise UserError(
            f"scene.particles_per_edge={per_edge} is too coarse for scene.mesh={path}: no particle lies inside; "
            "accepted: more of them, or a thicker body"
        )
    return np.stack((x[i], y[j], z[k]), axis=1), surface.volume


def read_surface(path: str | Path) -> ClosedSurface:
    """The closed surface of a mesh file.

    raises  UserError, one line, for whatever is wrong with the file
    """
    trimesh = _trimesh(path)
    vertices, faces = _triangles(trimesh, path)
    corners = vertices[faces].reshape(-1, 3)
    low, high = corners.min(0), corners.max(0)
    if not np.isfinite(high - low).all() or not (high > low).any():
        raise UserError(f"scene.mesh={path} has coordinates that are not finite, or all the same; {ACCEPTED}")
    # Files repeat a vertex for every face or patch of texture: trimesh makes one of what is within 1e-8.
    mesh = trimesh.Trimesh((vertices - 0.5 * (low + high)) / (high - low).max(), faces)
    if not mesh.is_watertight:
        raise UserError(f"scene.mesh={path} is not watertight: some edge does not belong to two faces; {ACCEPTED}")
    if not mesh.is_winding_consistent:
        raise UserError(f"scene.mesh={path} has neighbouring faces that disagree on what is outside; {ACCEPTED}")
    volume = float(np.linalg.det(mesh.triangles).sum()) / 6.0  # mesh.volume divides by zero where the mesh is flat
    outwards = mesh.faces if volume >= 0.0 else mesh.faces[:, ::-1]
    return ClosedSurface(np.array(mesh.vertices), np.array(outwards), abs(volume))


def _along(extent: float, per_edge: int) -> Float[np.ndarray, " points"]:
    """Points 1 / (per_edge - 1) apart that fit into an edge of the bounding box, about 0."""
    gaps = int(extent * (per_edge - 1) * (1.0 + ROUNDING))
    return (np.arange(gaps + 1) - 0.5 * gaps) / (per_edge - 1)


def _trimesh(path: str | Path) -> ModuleType:
    try:
        import trimesh
    except ImportError as error:
        raise UserError(
            f"scene.mesh={path} needs trimesh, which is not installed; "
            "accepted: pip install pcnclaws[mesh], or scene.particles=FILE"
        ) from error
    return trimesh


def _triangles(trimesh: ModuleType, path: str | Path) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]:
    """The file's triangles, without those that use a vertex twice."""
    if not Path(path).is_file():
        raise UserError(f"scene.mesh={path}: no such file; {ACCEPTED}")
    try:
        mesh = trimesh.load_mesh(str(path), process=False)
        vertices, faces = np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces, dtype=np.int64)
    except Exception as error:  # trimesh's many readers raise whatever a damaged file makes them meet
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise UserError(f"scene.mesh={path} cannot be read by trimesh ({reason}); {ACCEPTED}") from error
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(1)]
    if len(faces) == 0:
        raise UserError(f"scene.mesh={path} holds no triangle; {ACCEPTED}")
    return vertices, faces
