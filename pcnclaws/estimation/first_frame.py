"""Error of the first frame, where each marker is put on the body: it goes along with the body ever after."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from pcnclaws.estimation.problem import EstimationProblem

# Particles around a marker that tell how the body deforms there.
AROUND = 8


class Rest(NamedTuple):
    """A residual less the error of the first frame.

    field     without the likeliest error of the first frame [m], (frames, markers, 3)
    variance  of the errors of the other frames that explains field and error of the first frame alike [m^2]
    """

    field: Float[np.ndarray, "frames markers 3"]
    variance: float


def local_deformation(
    problem: EstimationProblem, u: Float[np.ndarray, " unknowns"]
) -> Float[np.ndarray, "frames markers 3 3"]:
    """How the body around each marker is deformed and turned in the simulation [-], by least squares."""
    observation = problem.observation
    place = observation.places
    particle = KDTree(observation.position).query(place, k=min(AROUND, len(observation.position)))[1]
    particle = particle.reshape(len(place), -1).astype(np.int64)
    around = observation.position[particle]
    weight = np.linalg.pinv(around - around.mean(1, keepdims=True), rcond=1e-6)
    columns = replace(
        observation,
        target=np.zeros((len(observation.time), 3 * len(place), 3)),
        particle=np.repeat(particle, 3, axis=0),
        weight=weight.reshape(3 * len(place), -1),
    )
    gradient = EstimationProblem(problem.laws, columns, problem.unknowns, problem.execution).motion(u)
    return np.swapaxes(gradient.reshape(len(observation.time), len(place), 3, 3), 2, 3).astype(np.float64)


def without_first_error(
    field: Float[np.ndarray, "frames markers 3"], deformation: Float[np.ndarray, "frames markers 3 3"]
) -> Rest:
    """What is left of a residual.

    With errors e(t) of each frame and o of the first one, all of one variance, a residual is r = e - G o, and its
    covariance I + G G^T: r^T (I + G G^T)^-1 r over its rows is the variance of e, however G turns and stretches o.
    field  NaN where a marker was not seen
    """
    seen = np.asarray(np.isfinite(field).all(2))
    residual = np.where(seen[..., None], field, 0.0)
    deformation = np.where(seen[..., None, None], deformation, 0.0)
    pulled = np.einsum("fmij,fmi->mj", deformation, residual)
    normal = np.eye(3) + np.einsum("fmij,fmik->mjk", deformation, deformation)
    first = np.linalg.solve(normal, pulled[..., None])[..., 0]
    square = np.sum(np.square(residual)) - np.sum(pulled * first)
    clean = residual - np.einsum("fmij,mj->fmi", deformation, first)
    return Rest(np.where(seen[..., None], clean, np.nan), float(square) / max(3 * int(seen.sum()), 1))
