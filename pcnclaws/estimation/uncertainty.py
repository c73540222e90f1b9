"""Uncertainty of an estimate: covariance, intervals, and what the motion cannot tell.

Two errors add up. That of the observation is random from one position to the next, and many positions average it out:
s^2 (J J^T)^-1. That of the law is the same wrong motion everywhere, however many positions are seen: a law that moves a
marker wrongly by d, in the way that an unknown would, shifts the estimate by the least-squares fit of d, whatever the
number of rows: d^2 (J J^T / rows)^-1. d is calibrated on objects whose truth is known.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from pcnclaws.estimation.discrepancy import QUANTILE_95, Discrepancy
from pcnclaws.estimation.problem import Linearisation
from pcnclaws.estimation.surroundings import ROUNDING
from pcnclaws.estimation.unknowns import WIDEST_SURROUNDINGS, Unknown, Unknowns
from pcnclaws.laws.parameters import PARAMETERS

# Two unknowns that are this much correlated can stand for one another.
CORRELATED = 0.98


@dataclass(frozen=True)
class Estimate:
    """One unknown: its number, its interval, and whether the motion tells it.

    law_share  of the interval's variance that the law's error makes [-]
    ahead      its number after one more Gauss-Newton step: another one where a search has stopped on its way
    converged  whether that step is small beside the uncertainty
    """

    label: str
    value: float
    interval: tuple[float, float]
    identifiable: bool
    law_share: float
    ahead: float
    converged: bool


@dataclass(frozen=True)
class Uncertainty:
    """What is known of all unknowns.

    covariance   of the coordinates, (unknowns, unknowns); infinite variance where the motion says nothing
    correlation  [-], (unknowns, unknowns)
    noise        scatter of the residual [m], at the minimum, or of the positions where it is known to be larger
    law_error    what the law moves a marker wrongly by, in the ways that the unknowns would [m]
    residual     at the minimum [m], (observed coordinates,)
    error_variance  of independent coordinates that would make the variance of each unknown [m^2], (unknowns,); infinite
                 where the motion says nothing
    freedom      observed coordinates that tell something, less the unknowns that have an influence
    """

    estimates: list[Estimate]
    covariance: Float[np.ndarray, "unknowns unknowns"]
    correlation: Float[np.ndarray, "unknowns unknowns"]
    noise: float
    law_error: float
    residual: Float[np.ndarray, " rows"]
    error_variance: Float[np.ndarray, " unknowns"]
    freedom: int


def uncertainty(
    at: Linearisation,
    unknowns: Unknowns,
    u: Float[np.ndarray, " unknowns"],
    law_error: float,
    noise: float | None = None,
    discrepancy: Discrepancy | None = None,
    doubt: Float[np.ndarray, "errors unknowns"] | None = None,
) -> Uncertainty:
    """The uncertainty at the end of a search.

    Covariances are those of the minimum. Where the search has not come to it, an interval reaches twice as far as the
    next Gauss-Newton step, which is right to its order alone, and by its half-width further.
    law_error  calibrated error of the law [m]
    noise      standard deviation of an observed coordinate [m]; None: that of the residual
    discrepancy  the error of a wrong model, in place of independent errors of that size
    doubt        errors of all coordinates in common, one standard deviation of each
    """
    rows = at.jacobian.shape[1]
    normal = at.jacobian @ at.jacobian.T
    # a unit of the coordinate moves the markers by this much
    felt = np.sqrt(np.diag(normal) / rows) > ROUNDING
    inverse, step = _inverse(normal, felt), np.zeros(len(u))
    step[felt] = -inverse[np.ix_(felt, felt)] @ (at.jacobian @ at.residual)[felt]
    minimum = at._replace(residual=at.residual + step @ at.jacobian)
    # the first frame is right by construction, and says nothing of the noise
    telling = (np.abs(at.residual) > ROUNDING) | np.any(at.jacobian != 0.0, axis=0)
    freedom = int(telling.sum() - felt.sum())
    scatter = float(np.sqrt(np.sum(np.square(minimum.residual)) / max(freedom, 1)))
    noise = max(scatter, noise or 0.0, ROUNDING)
    of_noise = noise**2 * inverse * _clustering(minimum, inverse, noise, felt)
    if discrepancy is not None and felt.any():
        told = np.ix_(felt, felt)
        of_noise[told] = inverse[told] @ discrepancy.projected(at.jacobian[felt]) @ inverse[told]
    of_law = law_error**2 * rows * inverse
    covariance = of_noise + of_law
    if doubt is not None:
        covariance = covariance + doubt.T @ doubt
    deviation = np.sqrt(np.diag(covariance))
    with np.errstate(invalid="ignore"):
        share = np.where(felt, np.diag(of_law) / np.diag(covariance), 0.0)
        correlation = np.where(np.outer(felt, felt), covariance / np.outer(deviation, deviation), 0.0)
        error_variance = np.where(felt, np.diag(covariance) / np.diag(inverse), np.inf)
    estimates = [
        replace(_estimate(unknown, u[k], step[k], deviation[k]), law_share=float(share[k]))
        for k, unknown in enumerate(unknowns.sought)
    ]
    return Uncertainty(
        estimates,
        covariance,
        correlation,
        noise=noise,
        law_error=law_error,
        residual=minimum.residual,
        error_variance=error_variance,
        freedom=freedom,
    )


def projected_error(at: Linearisation, difference: Float[np.ndarray, " unknowns"]) -> Float[np.ndarray, " unknowns"]:
    """The error of a law [m] that explains each difference of an estimate from the truth, in coordinates.

    The calibration of `law_error`: |difference| over its deviation for a law error of 1 m.
    """
    rows = at.jacobian.shape[1]
    normal = at.jacobian @ at.jacobian.T
    felt = np.sqrt(np.diag(normal) / rows) > ROUNDING
    return np.abs(difference) / np.sqrt(rows * np.diag(_inverse(normal, felt)))


def _inverse(normal: np.ndarray, felt: np.ndarray) -> np.ndarray:
    """The inverse on the unknowns that are felt; infinite on the diagonal of the others."""
    result = np.diag(np.where(felt, 0.0, np.inf))
    if felt.any():
        scale = 1.0 / np.sqrt(np.diag(normal)[felt])
        scaled = normal[np.ix_(felt, felt)] * np.outer(scale, scale)
        result[np.ix_(felt, felt)] = np.linalg.pinv(scaled, rcond=1e-12, hermitian=True) * np.outer(scale, scale)
    return result


def _clustering(at: Linearisation, inverse: np.ndarray, noise: float, felt: np.ndarray) -> float:
    """By how much the errors of one marker at different times, which are alike, widen the variances; at least 1."""
    if not felt.any():
        return 1.0
    scores = np.stack([np.bincount(at.part, row * at.residual) for row in at.jacobian[felt]])
    part = inverse[np.ix_(felt, felt)]
    robust = part @ (scores @ scores.T) @ part
    return max(1.0, float(np.max(np.diag(robust) / (noise**2 * np.diag(part)))))


def _estimate(unknown: Unknown, u: float, step: float, deviation: float) -> Estimate:
    """The estimate of a coordinate, none of whose variance is the law's."""
    reach = QUANTILE_95 * deviation
    places = np.array([0.0, step, -reach, reach, 2.0 * min(step, 0.0) - reach, 2.0 * max(step, 0.0) + reach])
    value, ahead, least, most, low, high = unknown.transform.value(u + places).tolist()
    known = is_told(unknown, least, most)
    converged = bool(abs(step) <= deviation)
    return Estimate(
        unknown.label,
        value,
        interval=(low, high),
        identifiable=bool(np.isfinite(deviation) and known),
        law_share=0.0,
        ahead=ahead,
        converged=converged,
    )


def is_told(unknown: Unknown, low: float, high: float) -> bool:
    """Whether an interval from low to high says anything of an unknown."""
    parameter = PARAMETERS.get(unknown.name)
    if parameter is not None and parameter.logarithmic:
        return high < parameter.widest * low
    widest = WIDEST_SURROUNDINGS.get(unknown.name, np.inf) if parameter is None else parameter.widest
    return high - low < widest
