"""Winding numbers of the points of a lattice in a closed surface: once inside, not at all outside.

The lattice is cut into planes and each plane into rows, so the cost is that of the crossings, not points times faces.
A vertex that lies in a plane or a row counts as below it. Faces that share an edge cut it in the same place to the
last bit, so that no row slips through between them.
"""

import numpy as np
from jaxtyping import Float, Int

AlongX = Float[np.ndarray, " x"]
AlongY = Float[np.ndarray, " y"]
AlongZ = Float[np.ndarray, " z"]
Vertices = Float[np.ndarray, "vertices 3"]
Faces = Int[np.ndarray, "faces 3"]
Ends = Float[np.ndarray, "segments 2"]


def lattice_winding(vertices: Vertices, faces: Faces, x: AlongX, y: AlongY, z: AlongZ) -> Int[np.ndarray, "x y z"]:
    """Winding numbers of a surface around the lattice points (x_i, y_j, z_k) [-].

    vertices  [any unit of length]
    faces     triangles as rows of `vertices`, counterclockwise seen from outside; each edge belongs to two of them
    x, y, z   the lattice along each axis, ascending [the same unit]
    """
    return np.stack([_plane_winding(*_cut(vertices, faces, level), y, z) for level in x])


def _cut(vertices: Vertices, faces: Faces, level: float) -> tuple[Ends, Ends]:
    """Where the faces meet the plane x = level: starts and ends (y, z) of segments, which close to loops."""
    above = (vertices[:, 0] > level)[faces]
    met = above.any(1) & ~above.all(1)
    here, faces = above[met], faces[met]
    following = np.roll(here, -1, axis=1)
    # the boundary of a face crosses the plane once upwards and once downwards
    up, down = (crossing.argmax(1) for crossing in (~here & following, here & ~following))
    return _on_edge(vertices, _edge(faces, up), level), _on_edge(vertices, _edge(faces, down), level)


def _edge(faces: Faces, corner: Int[np.ndarray, " faces"]) -> Int[np.ndarray, "faces 2"]:
    """The edge of each face from the given corner to the next, in the order that both of its faces give it."""
    each = np.arange(len(faces))
    return np.sort(np.stack((faces[each, corner], faces[each, (corner + 1) % 3]), axis=1), axis=1)


def _on_edge(vertices: Vertices, edges: Int[np.ndarray, "edges 2"], level: float) -> Float[np.ndarray, "edges 2"]:
    """The points (y, z) of edges at x = level."""
    one, other = vertices[edges[:, 0]], vertices[edges[:, 1]]
    share = (level - one[:, :1]) / (other[:, :1] - one[:, :1])
    return one[:, 1:] + share * (other[:, 1:] - one[:, 1:])


def _plane_winding(start: Ends, end: Ends, y: AlongY, z: AlongZ) -> Int[np.ndarray, "y z"]:
    """Winding numbers of loops of segments around the points (y_j, z_k): what crosses y_j above z_k, with its sign."""
    after = end[:, :1] > y
    segment, row = np.nonzero((start[:, :1] > y) != after)
    (y0, z0), (y1, z1) = start[segment].T, end[segment].T
    height = z0 + (y[row] - y0) / (y1 - y0) * (z1 - z0)
    crossings = np.zeros((len(y), len(z) + 1), dtype=np.int64)
    np.add.at(crossings, (row, np.searchsorted(z, height)), np.where(after[segment, row], 1, -1))
    return crossings[:, :0:-1].cumsum(1)[:, ::-1]
