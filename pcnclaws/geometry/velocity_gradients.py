"""The velocity gradient that a body starts with: of a rigid rotation, or of a field that is known at its particles.

Without it the first transfer to the grid is that of PIC, which takes the spin of what is smaller than a cell.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float, Int64

# Neighbours of a particle: at most those around it in a lattice, not farther than this many spacings.
MOST_NEIGHBOURS, REACH = 26, 1.8
FEWEST_NEIGHBOURS = 4
# A direction in which the neighbours spread less than this, relative to the widest, has no gradient.
FLAT = 1e-6
PARTICLES_AT_ONCE = 2**16


def spin_gradient(spin: Sequence[float | int]) -> Float[np.ndarray, "3 3"]:
    """The velocity gradient W of a rigid rotation, W x = spin x x [1/s].

    spin  [rad/s]
    """
    x, y, z = (float(component) for component in spin)
    return np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))


def velocity_gradients(
    position: Float[np.ndarray, "particles 3"],
    velocity: Float[np.ndarray, "particles 3"],
    volume: Float[np.ndarray, " particles"],
) -> Float[np.ndarray, "particles 3 3"]:
    """The gradient of a velocity field at each particle [1/s]: the least-squares fit to its nearest neighbours.

    Exact for an affine field on any cloud of particles, also at its surface, where a gradient gathered from the grid
    is not. Particles that few or no others are near, as in a spray, have none.
    position  [m], (particles, 3)
    velocity  [m/s], (particles, 3)
    volume    [m^3], (particles,); its cube root is the spacing of particles
    """
    result = np.zeros((len(position), 3, 3))
    for part, neighbour, near, offset, inverse in _neighbourhoods(position, volume):
        change = velocity[neighbour] - velocity[part, None]
        fitted = np.einsum("pn,pni,pnj->pij", near, change, offset) @ inverse
        enough = near.sum(1) > FEWEST_NEIGHBOURS
        result[part][enough] = fitted[enough]
    return result


def gradient_weights(
    position: Float[np.ndarray, "particles 3"], volume: Float[np.ndarray, " particles"]
) -> tuple[Int64[np.ndarray, "particles neighbours"], Float[np.ndarray, "particles neighbours 3"]]:
    """The neighbours of each particle and their weights w [1/m], with which the fit is linear in the velocities.

    velocity_gradients is C[p, i, j] = sum over n of (velocity[n, i] - velocity[p, i]) w[p, n, j].
    """
    if len(position) <= FEWEST_NEIGHBOURS:
        return np.zeros((len(position), 0), np.int64), np.zeros((len(position), 0, 3))
    neighbours, weights = [], []
    for _, neighbour, near, offset, inverse in _neighbourhoods(position, volume):
        used = near * (near.sum(1, keepdims=True) > FEWEST_NEIGHBOURS)
        neighbours.append(neighbour)
        weights.append(used[:, :, None] * offset @ inverse)
    return np.concatenate(neighbours).astype(np.int64), np.concatenate(weights)


def _neighbourhoods(
    position: Float[np.ndarray, "particles 3"], volume: Float[np.ndarray, " particles"]
) -> Iterator[tuple[slice, np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
    """Of the particles, some at a time: the nearest others, which of them count (1 or 0), the offsets to them [m], and
    the inverse of the matrix of their spread [1/m^2]."""
    if len(position) <= FEWEST_NEIGHBOURS:
        return
    from scipy.spatial import KDTree  # takes its time to load, and most bodies need none

    tree, count = KDTree(position), min(MOST_NEIGHBOURS + 1, len(position))
    for first in range(0, len(position), PARTICLES_AT_ONCE):
        part = slice(first, first + PARTICLES_AT_ONCE)
        distance, nearest = tree.query(position[part], k=count)
        neighbour, edge = np.asarray(nearest), np.cbrt(volume[part])
        # lattices that include the faces of a body are wider than the edge of a particle
        reach = REACH * np.clip(distance[:, 1], edge, 2.0 * edge)
        near = (distance <= reach[:, None]).astype(np.float64)  # itself among them, which adds nothing
        offset = position[neighbour] - position[part, None]
        spread = np.einsum("pn,pni,pnj->pij", near, offset, offset)
        yield part, neighbour, near, offset, np.linalg.pinv(spread, FLAT, hermitian=True)
