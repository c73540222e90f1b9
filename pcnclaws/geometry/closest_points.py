"""Closest points of triangles."""

from typing import TypeAlias

import numpy as np
from jaxtyping import Float

Points: TypeAlias = Float[np.ndarray, "points 3"]


def closest_points(points: Points, triangles: Float[np.ndarray, "points 3 3"]) -> Points:
    """The point of each triangle that is nearest to each point: on its inside, or else on one of its edges."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    normal = np.cross(b - a, c - a)
    area = np.maximum(np.square(normal).sum(1, keepdims=True), 1e-300)
    on_plane = points - (np.sum((points - a) * normal, 1, keepdims=True) / area) * normal
    best = on_plane.copy()
    least = np.full(len(points), np.inf)
    inside = np.ones(len(points), dtype=bool)
    for begin, end in ((a, b), (b, c), (c, a)):
        edge, to_point = end - begin, points - begin
        inside &= np.sum(np.cross(edge, on_plane - begin) * normal, 1) > 0.0
        length = np.maximum(np.square(edge).sum(1), 1e-300)
        share = np.clip(np.sum(to_point * edge, 1) / length, 0.0, 1.0)
        on_edge = begin + share[:, None] * edge
        distance = np.square(points - on_edge).sum(1)
        nearer = distance < least
        best[nearer], least[nearer] = on_edge[nearer], distance[nearer]
    return np.where(inside[:, None], on_plane, best)


def shares_of_corners(point: Points, triangles: Float[np.ndarray, "points 3 3"]) -> Points:
    """Barycentric coordinates of points on triangles [-], each (3,) of sum 1; of a triangle without area, thirds."""
    a, b, c = triangles[:, 0] - point, triangles[:, 1] - point, triangles[:, 2] - point
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    parts = np.stack([np.sum(np.cross(*pair) * normal, 1) for pair in ((b, c), (c, a), (a, b))], axis=1)
    total = parts.sum(1, keepdims=True)
    return np.where(total > 1e-300, parts / np.maximum(total, 1e-300), 1.0 / 3.0)
