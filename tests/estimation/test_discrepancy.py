"""Errors of a model that are alike in time and space: their size and reach, and intervals that hold the truth."""

from dataclasses import replace

import numpy as np
import pytest
from observed_bodies import TRUTH, observed, problem_of, start

from pcnclaws.data.observation import Observation
from pcnclaws.estimation.discrepancy import Discrepancy, discrepancy_of, is_pattern
from pcnclaws.estimation.problem import EstimationProblem, Linearisation
from pcnclaws.estimation.uncertainty import Uncertainty, uncertainty

# PyTorch warns of its own use of torch.jit when it loads forward mode
pytestmark = pytest.mark.filterwarnings("ignore:`torch.jit.script` is deprecated:DeprecationWarning")
SIZE, TIME, LENGTH = 2e-3, 0.01, 0.1


@pytest.fixture(scope="module")
def problem() -> EstimationProblem:
    return problem_of(observed(start("elasticity"), steps=120, every=5))


@pytest.fixture(scope="module")
def at(problem: EstimationProblem) -> Linearisation:
    return problem.linearise(truth_of(problem))


def truth_of(problem: EstimationProblem) -> np.ndarray:
    return problem.unknowns.coordinates(list(TRUTH["elasticity"].values()))


def patterns(observation: Observation, draws: int, seed: int = 0) -> np.ndarray:
    """Errors of a process that is alike over TIME and LENGTH, (draws, rows)."""
    time, place = observation.time, observation.places
    in_time = np.exp(-np.abs(time[:, None] - time) / TIME)
    in_space = np.exp(-np.linalg.norm(place[:, None] - place, axis=2) / LENGTH)
    roots = np.linalg.cholesky(in_time), np.linalg.cholesky(in_space)
    white = np.random.default_rng(seed).standard_normal((draws, len(time), 3, len(place)))
    field = SIZE * np.einsum("fg,mn,dgcn->dfcm", *roots, white, optimize=True)
    field[:, 0] = 0.0  # the first frame is right by construction
    return field.reshape(draws, -1)


def fitted(problem: EstimationProblem, at: Linearisation, error: np.ndarray) -> tuple[np.ndarray, Linearisation]:
    """Coordinates and what is left by the best fit of an error, of the linear problem at the truth."""
    step = np.linalg.lstsq(at.jacobian.T, error, rcond=None)[0]
    return truth_of(problem) - step, at._replace(residual=error - at.jacobian.T @ step)


def known(problem: EstimationProblem, residual: np.ndarray) -> Discrepancy:
    found = discrepancy_of(problem.observation, residual)
    assert found is not None
    return replace(found, margin=1.0)


def half_widths(found: Uncertainty) -> np.ndarray:
    return np.array([(one.interval[1] - one.interval[0]) / 2.0 for one in found.estimates])


def test_size_and_reach_of_a_process_are_found(problem: EstimationProblem) -> None:
    found = [known(problem, error) for error in patterns(problem.observation, 40)]
    assert np.median([one.size for one in found]) == pytest.approx(SIZE, rel=0.15)
    assert np.median([one.time for one in found]) == pytest.approx(TIME, rel=0.4)
    assert np.median([one.length for one in found]) == pytest.approx(LENGTH, rel=0.4)
    assert all(one.patterns < len(problem.observation.time) * 64 for one in found)


def test_intervals_hold_the_truth_where_errors_are_patterns(problem: EstimationProblem, at: Linearisation) -> None:
    covered, before = [], []
    for error in patterns(problem.observation, 200, seed=1):
        u, there = fitted(problem, at, error)
        for widened, hits in ((known(problem, there.residual), covered), (None, before)):
            found = uncertainty(there, problem.unknowns, u, 0.0, discrepancy=widened)
            truths = TRUTH["elasticity"].values()
            hits += [
                one.interval[0] < true < one.interval[1] for one, true in zip(found.estimates, truths, strict=True)
            ]
    assert 0.85 <= np.mean(covered) <= 0.99
    assert np.mean(before) < np.mean(covered) - 0.1


def test_errors_that_are_white_are_no_patterns(problem: EstimationProblem, at: Linearisation) -> None:
    white = SIZE * np.random.default_rng(2).standard_normal(at.residual.shape)
    white.reshape(len(problem.observation.time), -1)[0] = 0.0
    u, there = fitted(problem, at, white)
    plain = uncertainty(there, problem.unknowns, u, 0.0)
    widened = uncertainty(there, problem.unknowns, u, 0.0, discrepancy=known(problem, there.residual))
    np.testing.assert_allclose(half_widths(widened), half_widths(plain), rtol=0.35)


def test_more_markers_at_the_same_places_tell_no_more(problem: EstimationProblem, at: Linearisation) -> None:
    error = patterns(problem.observation, 1, seed=3)[0]
    u, there = fitted(problem, at, error)
    once = uncertainty(there, problem.unknowns, u, 0.0, discrepancy=known(problem, there.residual))
    seen = problem.observation
    twice = replace(
        seen,
        target=np.tile(seen.target, (1, 2, 1)),
        particle=np.tile(seen.particle, (2, 1)),
        weight=np.tile(seen.weight, (2, 1)),
    )
    frames = len(seen.time)
    doubled = Linearisation(
        np.tile(there.residual.reshape(frames, 3, -1), (1, 1, 2)).ravel(),
        np.tile(there.jacobian.reshape(len(u), frames, 3, -1), (1, 1, 1, 2)).reshape(len(u), -1),
        np.tile(there.part, 2),
    )
    again = discrepancy_of(twice, doubled.residual)
    assert again is not None
    found = uncertainty(doubled, problem.unknowns, u, 0.0, discrepancy=replace(again, margin=1.0))
    np.testing.assert_allclose(half_widths(found), half_widths(once), rtol=0.2)


def test_patterns_are_told_from_white_errors_and_from_those_of_the_first_frame(problem: EstimationProblem) -> None:
    generator, shape = np.random.default_rng(4), (len(problem.observation.time), 3, 64)
    for _ in range(50):
        white = SIZE * generator.standard_normal(shape)
        first = np.broadcast_to(SIZE * generator.standard_normal(shape[1:]), shape)
        assert not is_pattern(problem.observation, white.ravel())
        assert not is_pattern(problem.observation, (white + first).ravel())
    assert all(is_pattern(problem.observation, error) for error in patterns(problem.observation, 20))


def test_too_few_frames_show_no_pattern(problem: EstimationProblem) -> None:
    two = problem.observation.between(0.0, float(problem.observation.time[1]))
    assert discrepancy_of(two, np.zeros(3 * int(two.seen.sum()))) is None
