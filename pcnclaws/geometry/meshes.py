"""Bodies from surface meshes: a file that trimesh reads, scaled to the unit box and filled with a lattice of particles.

The lattice is the cube's: `per_edge` points along the longest edge of the mesh's bounding box, and along the others as
many of the same spacing as fit, centred.
"""

import io
import logging
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from pcnclaws.errors import UserError, not_installed
from pcnclaws.geometry.lattices import lattice_points
from pcnclaws.geometry.mesh_faults import is_closed, single_faces, surface_fault, without_walls
from pcnclaws.geometry.winding import lattice_winding

log = logging.getLogger(__name__)

# A point this near to the surface, relative to its distance from the origin, is on it but for the single precision of
# most files.
ROUNDING = 1e-5
# Formats whose readers are part of trimesh; archives and XML, which can grow as they are read, are not among them.
ENDINGS = (".stl", ".obj", ".ply", ".off", ".glb", ".gltf")
ACCEPTED = "accepted: a watertight surface mesh, such as an .stl, .obj, .ply, .off or .glb file"


class ClosedSurface(NamedTuple):
    """A watertight mesh. Its bounding box is about the origin and has a longest edge of 1.

    vertices  [-], (vertices, 3)
    faces     rows of `vertices`, counterclockwise seen from outside, (faces, 3)
    volume    what it encloses [-], 0 where it is flat
    middle    of the bounding box in the file, in its unit of length, (3,)
    unit      longest edge of the bounding box in the file
    name      what messages call it: the option and the file
    """

    vertices: Float[np.ndarray, "vertices 3"]
    faces: Int[np.ndarray, "faces 3"]
    volume: float
    middle: Float[np.ndarray, "3"]
    unit: float
    name: str


def filled_surface(
    surface: ClosedSurface, per_edge: int, lattice: str = "faces"
) -> tuple[Float[np.ndarray, "particles 3"], float]:
    """The lattice points inside of a surface of longest edge 1 about the origin, and its volume.

    Points on the surface count where it faces away from the origin, as the faces of a box do.
    lattice  one of LATTICES
    raises   UserError where the surface overlaps with itself, and where no point lies inside
    """
    x, y, z = (lattice_points(float(extent), per_edge, lattice) for extent in np.ptp(surface.vertices, axis=0))
    inwards = 1.0 - ROUNDING
    winding = lattice_winding(surface.vertices, surface.faces, inwards * x, inwards * y, inwards * z)
    require_parts_apart(winding, surface, x, y, z)
    i, j, k = np.nonzero(winding)
    if len(i) == 0:
        raise UserError(
            f"scene.particles_per_edge={per_edge} is too coarse for {surface.name}: no particle lies inside; "
            "accepted: more of them, or a thicker body"
        )
    return np.stack((x[i], y[j], z[k]), axis=1), surface.volume


def require_parts_apart(
    winding: Int[np.ndarray, "x y z"],
    surface: ClosedSurface,
    x: Float[np.ndarray, " x"],
    y: Float[np.ndarray, " y"],
    z: Float[np.ndarray, " z"],
) -> None:
    """Refuses a surface that goes more than once around a point, or the wrong way, with a UserError.

    winding  numbers of the points of a lattice of these coordinates [-]
    """
    wrong = np.argwhere(~np.isin(winding, (0, 1)))
    if len(wrong):
        i, j, k = wrong[0]
        place = ", ".join(f"{c:.4g}" for c in surface.middle + surface.unit * np.array((x[i], y[j], z[k])))
        raise UserError(
            f"{surface.name} overlaps with itself, or faces the wrong way around a cavity, at {len(wrong)} of "
            f"{winding.size} lattice points, the first at ({place}) in the file; accepted: parts that do not overlap "
            "(trimesh.boolean.union makes one of them), their faces counterclockwise seen from outside of the material"
        )


def read_surface(path: str | Path, option: str = "scene.mesh") -> ClosedSurface:
    """The closed surface of a mesh file.

    option  what messages call it
    raises  UserError, one line, for whatever is wrong with the file
    """
    named = f"{option}={path}"
    return closed_surface(*_triangles(_trimesh(named), path, named), path, option)


def closed_surface(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], path: str | Path, option: str = "scene.mesh"
) -> ClosedSurface:
    """The closed surface of triangles, each of three different vertices; option and path name it in messages.

    raises  UserError, one line, for whatever is wrong with it
    """
    named = f"{option}={path}"
    trimesh = _trimesh(named)
    corners = vertices[faces].reshape(-1, 3)
    low, high = corners.min(0), corners.max(0)
    if not np.isfinite(high - low).all() or not (high > low).any():
        raise UserError(f"{named} has coordinates that are not finite, or all the same; {ACCEPTED}")
    middle, unit = 0.5 * (low + high), float((high - low).max())
    # Files repeat a vertex for every face or patch of texture: trimesh makes one of what is within 1e-8.
    mesh = trimesh.Trimesh((vertices - middle) / unit, faces)
    mesh.update_faces(_has_three_corners(mesh.faces))
    faces = _without_repetitions(np.array(mesh.faces), named)
    if fault := surface_fault(middle + unit * np.array(mesh.vertices), faces, path):
        raise UserError(f"{named} {fault}; {ACCEPTED}")
    # mesh.volume divides by zero where the mesh is flat
    volume = float(np.linalg.det(np.array(mesh.vertices)[faces]).sum()) / 6.0
    outwards = faces if volume >= 0.0 else faces[:, ::-1]
    return ClosedSurface(np.array(mesh.vertices), outwards, abs(volume), middle, unit=unit, name=named)


def _without_repetitions(faces: Int[np.ndarray, "faces 3"], named: str) -> Int[np.ndarray, "found 3"]:
    """The faces, each once, and without the walls between parts that touch where this closes the surface."""
    single = single_faces(faces)
    if len(single) < len(faces):
        log.warning("%s: %d faces are there more than once: each is taken once", named, len(faces) - len(single))
    if is_closed(single):
        return single
    joined = without_walls(single)
    if not len(joined) or not is_closed(joined):
        return single
    log.warning("%s: %d faces lie between parts that touch: these are taken as one", named, len(single) - len(joined))
    return joined


def _has_three_corners(faces: Int[np.ndarray, "faces 3"]) -> Bool[np.ndarray, " faces"]:
    return (faces != np.roll(faces, 1, axis=1)).all(1)


def _trimesh(named: str) -> ModuleType:
    try:
        import trimesh
    except ImportError as error:
        raise not_installed(named, "trimesh", "mesh", "scene.particles=FILE") from error
    return trimesh


def _triangles(
    trimesh: ModuleType, path: str | Path, named: str
) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]:
    """The file's triangles, without those that use a vertex twice."""
    if not Path(path).is_file():
        raise UserError(f"{named}: no such file; {ACCEPTED}")
    ending = Path(path).suffix.lower()
    if ending not in ENDINGS:
        raise UserError(f"{named}: '{ending}' is no known format; accepted: a file ending in {', '.join(ENDINGS)}")
    try:
        # of bytes without a name trimesh follows no name to other files: materials, textures, buffers
        content = io.BytesIO(Path(path).read_bytes())
        mesh = trimesh.load_mesh(content, file_type=ending[1:], process=False)
        vertices, faces = np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces, dtype=np.int64)
    except Exception as error:  # trimesh's many readers raise whatever a damaged file makes them meet
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise UserError(f"{named} cannot be read by trimesh ({reason}); {ACCEPTED}") from error
    if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3:
        raise UserError(f"{named} holds no triangles of three coordinates; {ACCEPTED}")
    if len(faces) and not 0 <= faces.min() <= faces.max() < len(vertices):
        raise UserError(f"{named} names the vertices {faces.min()} to {faces.max()} of {len(vertices)}; {ACCEPTED}")
    faces = faces[_has_three_corners(faces)]
    if len(faces) == 0:
        raise UserError(f"{named} holds no triangle; {ACCEPTED}")
    return vertices, faces
