"""Points of a surface that a distant camera sees, as a depth camera or a laser scanner would."""

import numpy as np
from jaxtyping import Bool, Float, Int64

from pcnclaws.geometry.particle_surface import face_normals

# Points drawn at once, until enough of them are seen; of no surface less than a thousandth is.
DRAWN_AT_ONCE, MOST_DRAWS = 4.0, 1000
# A point is behind a triangle that is nearer to the camera by more than this, over the extent of the surface.
BEHIND = 1e-6
POINTS_AT_ONCE = 256


def seen_points(
    vertices: Float[np.ndarray, "vertices 3"],
    faces: Int64[np.ndarray, "faces 3"],
    count: int,
    towards: Float[np.ndarray, "3"] | None,
    chance: np.random.Generator,
) -> Float[np.ndarray, "points 3"]:
    """Points at random on a closed surface, evenly over the area that is seen [m].

    faces    counterclockwise seen from outside
    towards  from the surface to the distant camera, any length; None: all of the surface is seen
    """
    corners = vertices[faces]
    normal = face_normals(corners)
    area = np.linalg.norm(normal, axis=1)
    if towards is not None:
        area = np.where(normal @ towards > 0.0, area, 0.0)
    found: list[np.ndarray] = []
    for _ in range(MOST_DRAWS):
        if sum(map(len, found)) >= count:
            break
        drawn = chance.choice(len(faces), int(DRAWN_AT_ONCE * count), p=area / area.sum())
        share = chance.dirichlet((1.0, 1.0, 1.0), len(drawn))
        place = np.einsum("pk,pkc->pc", share, corners[drawn])
        found.append(place if towards is None else place[~_hidden(place, corners, towards)])
    return np.concatenate(found)[:count]


def _hidden(
    place: Float[np.ndarray, "points 3"], corners: Float[np.ndarray, "faces 3 3"], towards: Float[np.ndarray, "3"]
) -> Bool[np.ndarray, " points"]:
    """Whether a triangle lies between a point and the camera."""
    direction = towards / np.linalg.norm(towards)
    across = np.linalg.svd(direction[None])[2][1:]
    flat, depth = corners @ across.T, corners @ direction
    first, second = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
    span = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    span = np.where(span == 0.0, np.inf, span)  # seen edge on, it hides nothing
    hidden = np.zeros(len(place), dtype=bool)
    nearer = BEHIND * float(np.ptp(corners.reshape(-1, 3), axis=0).max())
    for begin in range(0, len(place), POINTS_AT_ONCE):
        some = slice(begin, begin + POINTS_AT_ONCE)
        apart = (place[some] @ across.T)[:, None] - flat[:, 0]
        one = (apart[..., 0] * second[:, 1] - apart[..., 1] * second[:, 0]) / span
        other = (first[:, 0] * apart[..., 1] - first[:, 1] * apart[..., 0]) / span
        front = depth[:, 0] + one * (depth[:, 1] - depth[:, 0]) + other * (depth[:, 2] - depth[:, 0])
        met = np.isfinite(span) & (one > 0.0) & (other > 0.0) & (one + other < 1.0)
        hidden[some] = (met & (front > (place[some] @ direction)[:, None] + nearer)).any(1)
    return hidden
