"""Goodness of fit: the residual beside the scatter of the positions, and its pattern along a marker.

Errors of the positions are independent from frame to frame. A wrong model leaves a residual that is larger than they
are, and alike in neighbouring frames.
"""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float

from pcnclaws.data.observation import Observation, ObservedPoints
from pcnclaws.estimation.discrepancy import Discrepancy
from pcnclaws.estimation.first_frame import Rest, local_deformation, without_first_error
from pcnclaws.estimation.problem import EstimationProblem
from pcnclaws.estimation.scatter import FEWEST, Scatter, given_scatter, scatter_of, scatter_on_surface
from pcnclaws.estimation.uncertainty import Uncertainty
from pcnclaws.tensors.layout import vectors_last

# A right model leaves once the scatter, without the error of the first frame.
MOST_RESIDUAL = 1.5
# The part of the residual that is alike in neighbouring frames, over the scatter. It is none for a right model.
MOST_ALIKE = 0.7
# The calibrated error of a law is that in the way of the unknowns; all of it was at most 1.4 times as large on the
# reference objects, and more where other bodies move for longer.
LAW_MARGIN = 10.0
# No two simulations agree to more than this share of the grid spacing: the bound of the skip of bodies at rest.
GRID_SHARE = 1e-3
# Positions so near to the start were taken for the body's own [s].
AT_START = 1e-6
# So many of the markers, holding so much of the squared residual, are another fault than that of the model.
FEW_MARKERS, THEIR_SHARE = 0.125, 0.5
# Points farther from the surface than so many times their scatter are none of its points.
STRAY = 6.0


@dataclass(frozen=True)
class Fit:
    """What is left of a motion by the best parameters.

    residual   root mean square after the first frame [m]
    scatter    of the observed positions, None where it is not known
    alike      correlation of a marker's residual in neighbouring frames, without the error of the first frame
               [-]; None for few frames
    tolerance  what simulation and law are right to [m]
    odd        markers, numbered in their order, that hold most of the squared residual though they are few;
               none where the motion is fitted
    freedom    observed coordinates that tell something, less the numbers that are estimated
    fitted     whether the model explains the motion; None where that cannot be told
    stray      points without labels that are farther from the surface than their scatter explains, where they hold most
               of the squared residual
    discrepancy  the error of the model that the intervals reckon with where the motion is not fitted, None for none
    """

    residual: float
    scatter: Scatter | None
    alike: float | None
    tolerance: float
    odd: tuple[int, ...]
    freedom: int
    fitted: bool | None
    stray: int = 0
    discrepancy: Discrepancy | None = None

    @property
    def has_intervals(self) -> bool:
        """Whether intervals say anything: of a motion that is not fitted, or of errors of unknown size, none does."""
        if self.fitted is False:
            return self.discrepancy is not None
        return self.freedom > 0 or (self.scatter is not None and self.scatter.given)


def fit_of(
    problem: EstimationProblem, u: Float[np.ndarray, " unknowns"], found: Uncertainty, noise: float | None = None
) -> Fit:
    """The fit of a motion by the numbers that a search has ended with.

    noise  standard deviation of each observed coordinate [m], None where it is not known
    """
    observation = problem.observation
    if observation.points is not None:
        return _fit_of_points(observation.points, problem, u, found, noise)
    later = observation.time > AT_START
    field = _field(observation, found.residual)[later]
    size = float(np.sqrt(np.nanmean(np.square(field)))) if np.isfinite(field).any() else 0.0
    tolerance = _tolerance(problem, found)
    if noise is None:
        scatter = scatter_of(observation.time[later], (field, observation.target[later]), observation.places)
    else:
        scatter = given_scatter(noise)
    rest = Rest(field, size**2)
    if size > tolerance:
        rest = without_first_error(field, local_deformation(problem, u)[later])
    covariance, variance = _neighbours(rest.field)
    fitted = None
    if found.freedom > 0:
        fitted = size <= tolerance or _fitted(rest.variance, covariance, scatter, tolerance)
    alike = covariance / variance if variance > 0.0 else None
    return Fit(
        residual=size,
        scatter=scatter,
        alike=alike,
        tolerance=tolerance,
        odd=_odd(field) if fitted is False else (),
        freedom=found.freedom,
        fitted=fitted,
    )


def _fit_of_points(
    points: ObservedPoints,
    problem: EstimationProblem,
    u: Float[np.ndarray, " unknowns"],
    found: Uncertainty,
    noise: float | None,
) -> Fit:
    """As fit_of, of points: each tells its distance from the surface, and no error of the first frame is in it."""
    patch, residual = problem.parts(u), found.residual
    scatter = given_scatter(noise) if noise else scatter_on_surface(residual, points.position, points.frame, patch)
    tolerance, square = _tolerance(problem, found), float(np.mean(np.square(residual)))
    covariance = _neighbouring_patches(residual, points.frame, patch)
    fitted = None
    if found.freedom > 0:
        fitted = square <= tolerance**2 or _fitted(square, covariance, scatter, tolerance)
    return Fit(
        residual=float(np.sqrt(square)),
        scatter=scatter,
        alike=covariance / square if square > 0.0 else None,
        tolerance=tolerance,
        odd=(),
        freedom=found.freedom,
        fitted=fitted,
        stray=_stray(residual, scatter) if fitted is False else 0,
    )


def _stray(residual: np.ndarray, scatter: Scatter | None) -> int:
    """How many points are stray; 0 where the others hold most of the squared residual."""
    if scatter is None:
        return 0
    stray = np.abs(residual) > STRAY * scatter.largest
    return int(stray.sum()) if np.square(residual[stray]).sum() > THEIR_SHARE * np.square(residual).sum() else 0


def _neighbouring_patches(residual: np.ndarray, frame: np.ndarray, patch: np.ndarray) -> float:
    """Covariance [m^2] of the mean residuals of a patch in neighbouring frames, as if of single points; 0 for few."""
    total, count = np.zeros((2, int(frame.max()) + 1, int(patch.max()) + 1))
    np.add.at(total, (frame, patch), residual)
    np.add.at(count, (frame, patch), 1.0)
    mean = total / np.maximum(count, 1.0)
    weight = np.minimum(count[:-1], count[1:])
    if np.count_nonzero(weight) < FEWEST:
        return 0.0
    return float(np.average(mean[:-1] * mean[1:], weights=weight))


def _tolerance(problem: EstimationProblem, found: Uncertainty) -> float:
    return max(LAW_MARGIN * found.law_error, GRID_SHARE * problem.observation.settings.grid_spacing)


def _field(observation: Observation, residual: np.ndarray) -> Float[np.ndarray, "frames markers 3"]:
    """The residual by frame and marker, NaN where one was not seen."""
    by_coordinate = np.full((len(observation.time), 3, observation.target.shape[1]), np.nan)
    by_coordinate[np.broadcast_to(observation.seen[:, None], by_coordinate.shape)] = residual
    return vectors_last(torch.from_numpy(by_coordinate))


def _neighbours(field: Float[np.ndarray, "frames markers 3"]) -> tuple[float, float]:
    """Covariance and variance [m^2] of a marker's residual in neighbouring frames; zeros for few."""
    before, after = field[:-1], field[1:]
    both = np.isfinite(before * after)
    if both.sum() < FEWEST:
        return 0.0, 0.0
    variance = 0.5 * (np.square(before[both]) + np.square(after[both]))
    return float(np.mean(before[both] * after[both])), float(np.mean(variance))


def _fitted(square: float, covariance: float, scatter: Scatter | None, tolerance: float) -> bool | None:
    if scatter is None:
        return None
    if square > (MOST_RESIDUAL * scatter.largest) ** 2 + tolerance**2:
        return False
    # errors that the user knows may be alike, such as those of smoothed tracks
    return scatter.given or covariance <= (MOST_ALIKE * scatter.largest) ** 2 + tolerance**2


def _odd(field: Float[np.ndarray, "frames markers 3"]) -> tuple[int, ...]:
    share = np.nansum(np.square(field), axis=(0, 2))
    worst = np.argsort(-share)
    held = np.cumsum(share[worst])
    needed = int(np.searchsorted(held, THEIR_SHARE * held[-1])) + 1
    return tuple(np.sort(worst[:needed]).tolist()) if 0.0 < needed <= FEW_MARKERS * len(share) else ()
