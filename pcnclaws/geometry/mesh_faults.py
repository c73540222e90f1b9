"""Faults of a surface that should be closed: how many edges, where the first one is, and how to mend it."""

from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

Faces = Int[np.ndarray, "faces 3"]
SomeFaces = Int[np.ndarray, "some 3"]
Vertices = Float[np.ndarray, "vertices 3"]

# With trimesh, as it is typed in Python; it closes holes of three and four edges.
MEND = "python -c \"import trimesh; m = trimesh.load_mesh('{path}'); {way}; m.export('mended.ply')\""
FILL_HOLES = "m.merge_vertices(digits_vertex=5); trimesh.repair.fill_holes(m)"
FIX_NORMALS = "trimesh.repair.fix_normals(m)"


def single_faces(faces: Faces) -> SomeFaces:
    """The faces without repetitions: of those with the same vertices in the same sense, the first one."""
    _, first = np.unique(_from_smallest(faces), axis=0, return_index=True)
    return faces[np.sort(first)]


def without_walls(faces: Faces) -> SomeFaces:
    """The faces without pairs that have the same vertices in opposite sense: they enclose nothing.

    Two parts that touch in such faces become one.
    faces  without repetitions
    """
    forth, back = _from_smallest(faces), _from_smallest(faces[:, ::-1])
    _, number = np.unique(np.concatenate((forth, back)), axis=0, return_inverse=True)
    return faces[~np.isin(number[: len(faces)], number[len(faces) :])]


def is_closed(faces: Faces) -> bool:
    """Whether every edge belongs to two faces."""
    return bool((_edges(faces)[1] == 2).all())


def surface_fault(vertices: Vertices, faces: Faces, path: str | Path) -> str | None:
    """The first fault of a surface, with its number, its place and a way to mend it, in words; None for a closed one.

    vertices  in the units of the file
    faces     without repetitions
    """
    edges, count, forwards = _edges(faces)

    def fault(wrong: Bool[np.ndarray, " edges"], what: str, way: str) -> str:
        number, place = int(wrong.sum()), ", ".join(f"{x:.4g}" for x in vertices[edges[wrong][0]].mean(0))
        return f"{what} at {number} edge{'s' if number > 1 else ''}, the first at ({place}) in the file; {way}"

    if (count == 1).any():
        mended = f"holes of up to four edges are closed by {MEND.format(path=path, way=FILL_HOLES)}"
        return fault(count == 1, "is not watertight: it ends", mended)
    if not len(without_walls(faces)):
        return "has each of its faces twice, seen from both sides: nothing is inside; keep those that look outwards"
    if (count > 2).any():
        apart = "move the parts apart, or make one of them: trimesh.boolean.union(m.split()), with manifold3d"
        return fault(count > 2, "is not watertight: more than two faces meet", apart)
    if (forwards != 1).any():
        mended = f"they are turned by {MEND.format(path=path, way=FIX_NORMALS)}"
        return fault(forwards != 1, "has neighbouring faces that disagree on what is outside", mended)
    return None


def _edges(faces: Faces) -> tuple[Int[np.ndarray, "edges 2"], Int[np.ndarray, " edges"], Int[np.ndarray, " edges"]]:
    """Each edge once, how many faces it belongs to, and how many of these go along it from its smaller vertex."""
    directed = np.stack((faces, np.roll(faces, -1, axis=1)), axis=-1).reshape(-1, 2)
    edges, number, count = np.unique(np.sort(directed, axis=1), axis=0, return_inverse=True, return_counts=True)
    forwards = np.bincount(number.ravel(), directed[:, 0] < directed[:, 1], len(edges))
    return edges, count, forwards.astype(np.int64)


def _from_smallest(faces: Faces) -> Faces:
    """The faces, each turned so that its smallest vertex comes first."""
    start = faces.argmin(1)[:, None]
    return np.take_along_axis(faces, (start + np.arange(3)) % 3, axis=1)
