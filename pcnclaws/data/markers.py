"""Markers on a body: which particles each of them follows, and which particles could carry one."""

import numpy as np
from jaxtyping import Bool, Float, Int64
from scipy.spatial import KDTree

from pcnclaws.errors import UserError

# Particles that a marker follows: those around it in a lattice.
FOLLOWED = 8
# Of one that stands off a face, whose nearest particles are in a plane, as many as it takes; and how near to its place
# the particles have to put a marker, over the reach.
BEYOND_A_FACE, PLACED = (27, 64), 1e-6
# Factor between the extents of markers and body that a choice of markers does not explain.
SPAN = 5.0


def followed_particles(
    marker: Float[np.ndarray, "markers 3"],
    names: list[str],
    position: Float[np.ndarray, "particles 3"],
    reach: float,
) -> tuple[Int64[np.ndarray, "markers followed"], Float[np.ndarray, "markers followed"]]:
    """The nearest particles of each marker, and weights that put it where it is, in any affine motion of them.

    marker    at the start [m]
    position  of the particles at the start [m]
    reach     largest accepted distance from the nearest particle [m]
    raises    UserError naming a marker that is farther from the body
    """
    tree = KDTree(position)
    distance, particle = _nearest(tree, marker, FOLLOWED)
    far = int(np.argmax(distance[:, 0]))
    if distance[far, 0] > reach:
        raise UserError(
            f"marker '{names[far]}' is {distance[far, 0]:.3g} m from the body; accepted: at most one grid cell, "
            f"{reach:.3g} m, at the start{_extents(marker, position)}"
        )
    weight = np.array([_weights(m, position[p], d) for m, p, d in zip(marker, particle, distance, strict=True)])
    for more in BEYOND_A_FACE:
        missed = np.linalg.norm(np.einsum("mk,mkc->mc", weight, position[particle]) - marker, axis=1)
        off = np.flatnonzero(missed > PLACED * reach)
        if not len(off) or particle.shape[1] >= len(position):
            break
        distance, around = _nearest(tree, marker, more)
        added = ((0, 0), (0, around.shape[1] - particle.shape[1]))
        particle, weight = np.pad(particle, added, mode="edge"), np.pad(weight, added)
        particle[off] = around[off]
        weight[off] = [_weights(marker[m], position[around[m]], distance[m]) for m in off]
    return particle.astype(np.int64), weight


def _nearest(tree: KDTree, marker: Float[np.ndarray, "markers 3"], count: int) -> tuple[np.ndarray, np.ndarray]:
    """Distances and numbers of the nearest particles, each (markers, count)."""
    count = min(count, tree.n)
    distance, particle = tree.query(marker, k=count)
    return distance.reshape(len(marker), count), particle.reshape(len(marker), count)


def _extents(marker: Float[np.ndarray, "markers 3"], position: Float[np.ndarray, "particles 3"]) -> str:
    """A hint where the markers span far more or far less than the body."""
    markers, body = (float(np.ptp(points, axis=0).max()) for points in (marker, position))
    if len(marker) < FOLLOWED or body / SPAN < markers < body * SPAN:
        return ""
    return f"; the markers span {markers:.3g} m and the body {body:.3g} m: in another unit?"


def surface_particles(position: Float[np.ndarray, "particles 3"]) -> Bool[np.ndarray, " particles"]:
    """Which particles of a lattice lie at the surface: those that lack one of the 26 neighbours of the inner ones.

    position  at the start [m]
    """
    tree = KDTree(position)
    spacing = float(np.median(tree.query(position, k=min(2, len(position)))[0].reshape(len(position), -1)[:, -1]))
    neighbours = tree.query_ball_point(position, 1.8 * spacing, return_length=True)
    return np.asarray(neighbours < 27)  # itself among them


def _weights(marker: np.ndarray, around: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """Weights of sum 1 whose mean position is the marker, near the inverse squares of the distances."""
    near = 1.0 / np.maximum(distance, 1e-9) ** 2
    near /= near.sum()
    moments = np.vstack((np.ones(len(around)), (around - marker).T / distance.max()))
    lacking = np.array((1.0, 0.0, 0.0, 0.0)) - moments @ near
    spread = (moments * near) @ moments.T
    return near + near * (moments.T @ np.linalg.pinv(spread, rcond=1e-9) @ lacking)
