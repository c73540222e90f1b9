"""Profile likelihood: that of the linear problem where it is linear, and of a scan where it is not."""

import numpy as np
import pytest
import torch
from observed_bodies import TRUTH, observed, problem_of, solved, start

from pcnclaws.estimation.discrepancy import QUANTILE_95
from pcnclaws.estimation.problem import EstimationProblem
from pcnclaws.estimation.profiles import profile
from pcnclaws.estimation.uncertainty import Uncertainty, uncertainty

# PyTorch warns of its own use of torch.jit when it loads forward mode
pytestmark = pytest.mark.filterwarnings("ignore:`torch.jit.script` is deprecated:DeprecationWarning")

STEPS = 40


def noisy(size: float, steps: int = STEPS, speed: float = -2.0) -> EstimationProblem:
    """An elastic cube of an upward speed [m/s], whose markers scatter by `size` [m]."""
    seen = observed(start("elasticity", (0.5, speed, 0.0)), steps, every=10, dtype=torch.float64)
    seen.target[1:] += size * np.random.default_rng(3).normal(size=seen.target[1:].shape)
    return problem_of(seen, dtype=torch.float64)


def estimated(problem: EstimationProblem) -> tuple[np.ndarray, Uncertainty]:
    u, at = solved(problem, list(TRUTH["elasticity"].values()), iterations=8)
    return u, uncertainty(at, problem.unknowns, u, law_error=1e-9)


def test_where_the_problem_is_linear_the_profile_is_its_interval() -> None:
    problem = noisy(1e-5)
    u, found = estimated(problem)
    sides = []
    one = profile(problem, u, found, 0, sides.append)
    assert one is not None
    assert sides == [1, 1]
    assert one.bounded == (True, True)
    np.testing.assert_allclose(one.interval, found.estimates[0].interval, rtol=2e-3)
    low, high = found.estimates[0].interval
    assert np.ptp(one.interval) == pytest.approx(high - low, rel=0.05)
    assert min(one.deviance) == 0.0
    assert list(one.values) == sorted(one.values)
    # a parabola in the number of deviations from the estimate
    away = (np.array(one.values) - found.estimates[0].value) / (0.5 * (high - low) / QUANTILE_95)
    np.testing.assert_allclose(one.deviance, np.square(away), rtol=0.1, atol=0.1)


def test_with_a_number_held_the_others_are_at_their_best() -> None:
    problem = noisy(3e-3)
    u, found = estimated(problem)
    one = profile(problem, u, found, 0)
    assert one is not None
    nearest = int(np.argmin(np.abs(np.array(one.values) - found.estimates[0].value)))
    held = problem.unknowns.sought[0].transform.coordinate(one.values[0])
    scan = u[1] + np.linspace(-3.0, 3.0, 121) * np.sqrt(found.covariance[1, 1])
    rows = problem.comparison.rows
    best = rows * min(problem.mse([np.array([held, other]) for other in scan]))
    least = rows * min(problem.mse([u]))
    expected = (best - least) / found.error_variance[0]
    assert one.deviance[0] - one.deviance[nearest] == pytest.approx(expected, rel=0.05, abs=0.05)


def test_a_number_without_influence_has_no_profile() -> None:
    problem = noisy(1e-4, steps=10, speed=2.0)  # still rising
    u, found = estimated(problem)
    assert profile(problem, u, found, 0) is None


def test_a_side_without_an_end_says_so() -> None:
    """Errors as large as the motion leave free Poisson's ratio: the profile stops at the ends of its range."""
    problem = noisy(0.05)
    u, found = estimated(problem)
    one = profile(problem, u, found, 1)
    assert one is not None
    assert False in one.bounded
    limits = problem.unknowns.sought[1].transform
    assert -0.4 <= one.interval[0] < one.interval[1] <= 0.49
    assert np.isfinite(limits.coordinate(one.interval[1]))
