"""Profile likelihood: how much worse a motion is explained with one number held, all others at their best.

The interval of `uncertainty` is that of the linear problem at the minimum. A profile follows the valley of the squared
residual itself, and is as lopsided as that is. Both reckon with the same errors: in a linear problem they are the same.
source  Venzon and Moolgavkar 1988, "A method for computing profile-likelihood-based confidence intervals"; Raue et al.
        2009, "Structural and practical identifiability analysis of partially observed dynamical models"
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from pcnclaws.estimation.discrepancy import QUANTILE_95
from pcnclaws.estimation.problem import EstimationProblem, Linearisation
from pcnclaws.estimation.uncertainty import Uncertainty

# A profile is followed in steps of so many deviations, or of a coordinate where that is less, and so many at most.
STEP, LONGEST_STEP, MOST_POINTS, SHORTEST = 0.8, 0.5, 10, 0.1
# A step that leads farther than to this deviance is gone again in between, so many times.
FARTHEST, MOST_BETWEEN = 2.0 * QUANTILE_95**2, 3
# The other numbers are at their best where another step would lower the deviance by less than this; so many steps.
ENOUGH, MOST_STEPS, MOST_HALVINGS = 0.05, 6, 4


@dataclass(frozen=True)
class Profile:
    """The profile of one unknown.

    values    it is held at, increasing, the estimate among them, (points,)
    deviance  twice the logarithm of the likelihood's ratio to the best one [-], (points,): how much the squared
              residual is larger, over the variance of its error; chi-squared of one degree of freedom for a right value
    interval  between the values where the deviance passes 1.96^2
    bounded   whether it does, below and above; where not, the interval ends at the last value that was tried
    """

    label: str
    values: tuple[float, ...]
    deviance: tuple[float, ...]
    interval: tuple[float, float]
    bounded: tuple[bool, bool]


class _Point(NamedTuple):
    """The best coordinates with one of them held, and the sum of the squared residual there [m^2]."""

    u: np.ndarray
    square: float


def profile(
    problem: EstimationProblem,
    u: Float[np.ndarray, " unknowns"],
    found: Uncertainty,
    number: int,
    progress: Callable[[int], None] | None = None,
) -> Profile | None:
    """The profile of unknown `number`, None where it has no influence on what was observed.

    u         coordinates of the estimate
    found     its uncertainty, whose errors the profile reckons with
    progress  called with 1 after each side
    """
    variance = float(found.error_variance[number])
    if not np.isfinite(variance):
        return None
    length = min(STEP * float(np.sqrt(found.covariance[number, number])), LONGEST_STEP)
    best = _best(problem, u, number, variance)
    sides = []
    for sign in (-1.0, 1.0):
        sides.append(_side(problem, best, number, sign * length, variance))
        if progress:
            progress(1)
    points = [*reversed(sides[0]), best, *sides[1]]
    squares = np.array([point.square for point in points])
    held = np.array([point.u[number] for point in points])
    deviance = (squares - squares.min()) / variance
    middle = int(np.argmin(squares))
    low, below = _end(held[middle::-1], deviance[middle::-1])
    high, above = _end(held[middle:], deviance[middle:])
    unknown = problem.unknowns.sought[number]
    values = unknown.transform.value(np.array([*held, low, high])).tolist()
    return Profile(
        unknown.label, tuple(values[:-2]), tuple(deviance.tolist()), (values[-2], values[-1]), (below, above)
    )


def _side(problem: EstimationProblem, best: _Point, number: int, length: float, variance: float) -> list[_Point]:
    """The profile from its middle on, by steps of the held coordinate, until the deviance is past the interval."""
    points, before = [best], best
    for _ in range(MOST_POINTS):
        last = points[-1]
        start = last.u + (last.u - before.u) if before is not last else last.u.copy()
        step = float(np.clip(length, *problem.unknowns.reach(last.u)[:, number]))
        if abs(step) < SHORTEST * abs(length):  # at the end of what is possible
            break
        start[number] = last.u[number] + step
        points.append(_best(problem, start, number, variance))
        before = last
        if points[-1].square - best.square > QUANTILE_95**2 * variance:
            points[-1:] = _between(problem, points, number, best.square, variance)
            break
    return points[1:]


def _between(
    problem: EstimationProblem, points: list[_Point], number: int, least: float, variance: float
) -> list[_Point]:
    """The last point of a side, and those before it that narrow down where the deviance passes that of the interval."""
    inside, outside = points[-2:]
    found = [outside]
    for _ in range(MOST_BETWEEN):
        if outside.square - least <= FARTHEST * variance:
            break
        middle = _best(problem, 0.5 * (inside.u + outside.u), number, variance)
        found.append(middle)
        if middle.square - least > QUANTILE_95**2 * variance:
            outside = middle
        else:
            inside = middle
    return sorted(found, key=lambda point: abs(point.u[number] - points[0].u[number]))


def _best(problem: EstimationProblem, u: np.ndarray, number: int, variance: float) -> _Point:
    """Gauss-Newton on the other unknowns; what its last step would gain is taken for gained."""
    here = problem.linearise(u)
    for _ in range(MOST_STEPS):
        step, gain = _step(here, number)
        if gain <= ENOUGH * variance:
            return _Point(u, _square(here) - gain)
        step = np.clip(step, *problem.unknowns.reach(u))
        for _ in range(MOST_HALVINGS):
            there = problem.linearise(u + step)
            if there.mse < here.mse:
                break
            step = 0.5 * step
        else:
            break
        u, here = u + step, there
    return _Point(u, _square(here))


def _step(at: Linearisation, number: int) -> tuple[np.ndarray, float]:
    """The Gauss-Newton step of all unknowns but one, and by how much the linear problem lowers the square [m^2]."""
    step = np.zeros(len(at.jacobian))
    if not np.isfinite(at.mse):
        return step, 0.0
    size = np.linalg.norm(at.jacobian, axis=1)
    others = (np.arange(len(step)) != number) & (size > 0.0)
    if others.any():
        scaled = at.jacobian[others] / size[others, None]
        step[others] = -np.linalg.lstsq(scaled.T, at.residual, rcond=1e-6)[0] / size[others]
    return step, max(_square(at) - float(np.sum(np.square(at.residual + step @ at.jacobian))), 0.0)


def _square(at: Linearisation) -> float:
    return at.mse * len(at.residual)


def _end(held: np.ndarray, deviance: np.ndarray) -> tuple[float, bool]:
    """Where the deviance passes that of the interval, from the middle on; the last place where it does not."""
    past = np.flatnonzero(deviance > QUANTILE_95**2)
    if not len(past):
        return float(held[-1]), False
    far = int(past[0])
    if not np.isfinite(deviance[far]):
        return float(held[far]), True
    # the root of the deviance is nearly linear
    before, after = np.sqrt(deviance[far - 1 : far + 1])
    share = (QUANTILE_95 - before) / (after - before)
    return float(held[far - 1] + share * (held[far] - held[far - 1])), True
