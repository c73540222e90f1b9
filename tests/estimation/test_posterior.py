"""Samples of the posterior: the Gaussian of the linear problem where it is linear, and bit for bit after a break."""

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad
from test_profiles import estimated, noisy

from pcnclaws.estimation.posterior import sampled
from pcnclaws.estimation.transforms import Free, Transform

# PyTorch warns of its own use of torch.jit when it loads forward mode
pytestmark = pytest.mark.filterwarnings("ignore:`torch.jit.script` is deprecated:DeprecationWarning")


@pytest.mark.slow
def test_samples_of_a_linear_problem_scatter_as_it_says_and_go_on_after_a_break(tmp_path: Path) -> None:
    problem = noisy(1e-4, steps=45)
    u, found = estimated(problem)
    made = []
    posterior = sampled(problem, u, found, simulations=1600, seed=0, kept=tmp_path / "a.npz", progress=made.append)
    assert posterior.labels == ("youngs_modulus", "poissons_ratio")
    assert posterior.effective > 50
    assert 0.3 < posterior.acceptance < 0.95
    assert sum(made) == pytest.approx(1600, rel=0.1)
    for number, one in enumerate(found.estimates):
        interval = posterior.interval(one.label)
        assert interval is not None
        assert np.ptp(interval) == pytest.approx(np.ptp(one.interval), rel=0.4)
        deviation = float(np.std(posterior.values[:, number]))
        assert np.mean(posterior.values[:, number]) == pytest.approx(one.value, abs=deviation)
    assert posterior.interval("friction_angle") is None


class _Stopped(Exception):
    pass


def test_interrupted_sampling_goes_on_bit_for_bit(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    problem = noisy(1e-4, steps=20)
    u, found = estimated(problem)
    whole = sampled(problem, u, found, simulations=80, seed=1, kept=tmp_path / "whole.npz")
    done = 0

    def stop(count: int) -> None:
        nonlocal done
        done += count
        if done > 50:
            raise _Stopped

    with pytest.raises(_Stopped):
        sampled(problem, u, found, simulations=80, seed=1, kept=tmp_path / "parts.npz", progress=stop)
    again = []
    parts = sampled(problem, u, found, simulations=80, seed=1, kept=tmp_path / "parts.npz", progress=again.append)
    np.testing.assert_array_equal(parts.values, whole.values)
    assert sum(again[1:]) < 80  # the first says what was there
    (tmp_path / "parts.npz").write_bytes(b"damaged")
    np.testing.assert_array_equal(
        sampled(problem, u, found, simulations=80, seed=1, kept=tmp_path / "parts.npz").values, whole.values
    )
    assert "parts.npz: not an .npz file of numbers, or damaged" in caplog.text


@pytest.mark.parametrize("transform", [Transform(1e2, 1e9, 1.0, logarithmic=True), Transform(-0.4, 0.49, 0.1)])
def test_the_prior_is_flat_in_the_number_or_in_its_logarithm(transform: Transform) -> None:
    """The probability of an interval of the number (or of its logarithm) is its share of the whole."""
    scale = np.log if transform.logarithmic else np.asarray
    low, high = (transform.coordinate(value) for value in ((1e3, 1e5) if transform.logarithmic else (-0.1, 0.2)))

    def density(u: float) -> float:
        return float(np.exp(transform.log_density(np.array([u]))[0]))

    whole, part = quad(density, -40.0, 40.0)[0], quad(density, low, high)[0]
    values = transform.value(np.array([low, high]))
    expected = float(np.ptp(scale(values)) / np.ptp(scale(np.array([transform.lower, transform.upper]))))
    assert part / whole == pytest.approx(expected, rel=1e-6)
    assert not Free().log_density(np.array([0.3, 5.0])).any()
