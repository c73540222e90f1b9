"""Connected bodies: particles whose neighbours, and their neighbours, reach one another at the start."""

import numpy as np
from jaxtyping import Float, Int32

from pcnclaws.simulation.particle_spacing import particle_spacing

# Neighbours are at most so many spacings apart: those along the diagonals of a cubic lattice are.
REACH = 1.8


def connected_bodies(
    position: Float[np.ndarray, "particles 3"], volume: Float[np.ndarray, " particles"]
) -> Int32[np.ndarray, " particles"]:
    """Number of the body that each particle belongs to, from 0 on in the order of the particles, (particles,).

    position  at the start [m]
    volume    [m^3]
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import KDTree

    place = position.astype(np.float64)
    pairs = KDTree(place).query_pairs(REACH * particle_spacing(place, volume), output_type="ndarray")
    joined = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(place), len(place)))
    _, body = connected_components(joined, directed=False)
    return body.astype(np.int32)
