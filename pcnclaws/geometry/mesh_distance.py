"""Signed distance of a closed surface, sampled once on a grid of nodes."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import distance_transform_edt

from pcnclaws.errors import UserError
from pcnclaws.geometry.closest_points import Points, closest_points
from pcnclaws.geometry.meshes import ClosedSurface, require_parts_apart
from pcnclaws.geometry.winding import lattice_winding

# Layers of nodes beyond the bounding box.
MARGIN = 2
# Distances are exact up to so many nodes from the surface; further away they are those from the triangle that is
# nearest to the nearest of such nodes.
BAND = 2
PAIRS_AT_A_TIME = 1_000_000


class SampledSurface(NamedTuple):
    """Signed distances of nodes from a surface, in units of the longest edge of its bounding box.

    distances  negative inside, (x, y, z)
    low        the first node; the bounding box is about the origin
    spacing    of the nodes
    """

    distances: Float[np.ndarray, "x y z"]
    low: Float[np.ndarray, "3"]
    spacing: float


def sampled_surface(surface: ClosedSurface, cells: int) -> SampledSurface:
    """The signed distance of a surface.

    cells   of the grid along the longest edge of the bounding box
    raises  UserError for a surface that overlaps with itself, and for one in which no node lies
    """
    counts = np.ceil(np.ptp(surface.vertices, axis=0) * cells - 1e-9).astype(int) + 2 * MARGIN + 1
    low = -0.5 * (counts - 1) / cells
    axes = [begin + np.arange(count) / cells for begin, count in zip(low, counts, strict=True)]
    winding = lattice_winding(surface.vertices, surface.faces, *axes)
    require_parts_apart(winding, surface, *axes)
    if not winding.any():
        raise UserError(f"{surface.name} is flat, or too thin for its {cells} cells: none of their nodes lies inside")
    nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    distance = _distances(surface.vertices[surface.faces], nodes, counts, 1.0 / cells).reshape(winding.shape)
    return SampledSurface(np.where(winding > 0, -distance, distance), low, 1.0 / cells)


def _distances(
    triangles: Float[np.ndarray, "faces 3 3"], nodes: Points, counts: Int[np.ndarray, "3"], spacing: float
) -> Float[np.ndarray, " points"]:
    """Distances of nodes from triangles."""
    squared, owner = _near(triangles, nodes, counts, spacing)
    unknown = (squared > (BAND * spacing) ** 2).reshape(counts)
    if unknown.any():
        nearest = np.array(distance_transform_edt(unknown, return_distances=False, return_indices=True))
        far = np.flatnonzero(unknown)
        face = owner[np.ravel_multi_index(tuple(nearest.reshape(3, -1)[:, far]), tuple(counts))]
        squared[far] = np.square(nodes[far] - closest_points(nodes[far], triangles[face])).sum(1)
    return np.sqrt(squared)


def _near(
    triangles: Float[np.ndarray, "faces 3 3"], nodes: Points, counts: Int[np.ndarray, "3"], spacing: float
) -> tuple[Float[np.ndarray, " points"], Int[np.ndarray, " points"]]:
    """Squared distance, and triangle, of the nodes in the bounding boxes of triangles, widened by the band."""
    squared, owner = np.full(len(nodes), np.inf), np.zeros(len(nodes), dtype=np.int64)
    first = np.floor((triangles.min(1) - nodes[0]) / spacing).astype(np.int64) - BAND
    last = np.ceil((triangles.max(1) - nodes[0]) / spacing).astype(np.int64) + BAND
    first, last = np.maximum(first, 0), np.minimum(last, counts - 1)
    sizes = last - first + 1
    pairs = sizes.prod(1)
    for some in np.split(np.arange(len(pairs)), np.flatnonzero(np.diff(np.cumsum(pairs) // PAIRS_AT_A_TIME)) + 1):
        face = np.repeat(some, pairs[some])
        within = np.arange(len(face)) - np.repeat(np.cumsum(pairs[some]) - pairs[some], pairs[some])
        x, rest = np.divmod(within, sizes[face, 1] * sizes[face, 2])
        y, z = np.divmod(rest, sizes[face, 2])
        i, j, k = first[face].T
        node = ((i + x) * counts[1] + j + y) * counts[2] + k + z
        found = closest_points(nodes[node], triangles[face])
        distance = np.square(nodes[node] - found).sum(1)
        np.minimum.at(squared, node, distance)
        front = distance == squared[node]
        owner[node[front]] = face[front]
    return squared, owner
