"""Weights of markers on a body that is larger or smaller than the one that they were put on."""

import numpy as np
from jaxtyping import Float

from pcnclaws.data.observation import Observation


def weights_of_growth(observation: Observation) -> Float[np.ndarray, "markers followed"]:
    """Changes of the weights of the followed particles with 1 / size - 1 [-], that keep each marker in its place.

    A body that is stretched by s about its centre c has its particles at c + s (x - c). With weights w + (1 / s - 1) b,
    where b has the sum 0 and sum b (x - c) = sum w (x - c), they put a marker where the weights w put it before, and
    what is exact for affine motions stays so. The shortest b is taken.
    """
    from_centre = observation.position[observation.particle] - observation.position.mean(0)
    equations = np.concatenate((np.ones((*observation.particle.shape, 1)), from_centre), axis=2).swapaxes(1, 2)
    wanted = np.einsum("mk,mkc->mc", observation.weight, from_centre)
    wanted = np.concatenate((np.zeros((len(wanted), 1)), wanted), axis=1)
    return np.einsum("mke,me->mk", np.linalg.pinv(equations, rcond=1e-6), wanted)
