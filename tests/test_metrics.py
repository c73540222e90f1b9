"""The error metrics, against numbers worked out by hand."""

import math

import numpy as np
import pytest

from pcnclaws.metrics import (
    mse_sum,
    object_size,
    position_mse,
    position_mse_by_frame,
    relative_stress_error,
    rms_percent,
)

TRUE = np.zeros((2, 2, 3), dtype=np.float32)


def shifted(frame: int, particle: int, by: tuple[float, float, float]) -> np.ndarray:
    predicted = TRUE.copy()
    predicted[frame, particle] = by
    return predicted


def test_mse_is_the_mean_over_particles_and_coordinates_averaged_over_frames() -> None:
    predicted = shifted(1, 0, (3.0, 0.0, 4.0))
    np.testing.assert_allclose(position_mse_by_frame(predicted, TRUE), [0.0, 25.0 / 6.0])
    assert position_mse(predicted, TRUE) == pytest.approx(25.0 / 12.0)
    assert mse_sum(position_mse(predicted, TRUE)) == pytest.approx(25.0 / 4.0)


def test_unobserved_particles_and_frames_do_not_count() -> None:
    true = TRUE.copy()
    true[0] = np.nan
    true[1, 1, 2] = np.nan
    predicted = shifted(1, 0, (3.0, 0.0, 0.0))
    by_frame = position_mse_by_frame(predicted, true)
    assert math.isnan(by_frame[0])
    assert by_frame[1] == pytest.approx(3.0)
    assert position_mse(predicted, true) == pytest.approx(3.0)


def test_a_prediction_that_is_not_a_number_is_never_taken_for_a_gap() -> None:
    assert math.isnan(position_mse(shifted(0, 0, (math.nan, 0.0, 0.0)), TRUE))


def test_nothing_observed_is_an_error() -> None:
    with pytest.raises(ValueError, match="no particle is observed"):
        position_mse(TRUE, np.full_like(TRUE, np.nan))


def test_small_errors_of_float32_positions_are_not_rounded_away() -> None:
    true = np.full((1, 1000, 3), 0.5, dtype=np.float32)
    predicted = np.nextafter(true, np.float32(1.0))
    assert position_mse(predicted, true) == pytest.approx(2.0**-48, rel=1e-12)


def test_rms_is_given_in_percent_of_the_cube_root_of_the_initial_volume() -> None:
    volume = np.full(1000, 0.125 / 1000, dtype=np.float32)
    assert object_size(volume) == pytest.approx(0.5)
    assert rms_percent(0.05**2, volume) == pytest.approx(10.0)


def test_relative_stress_error_is_a_ratio_of_summed_norms() -> None:
    true = np.stack((np.eye(3), 3.0 * np.eye(3)))
    assert relative_stress_error(1.1 * true, true) == pytest.approx(0.1)
    # a state without stress adds its absolute error only
    first_without = true * np.array([0.0, 1.0])[:, None, None]
    assert relative_stress_error(true, first_without) == pytest.approx(1.0 / 3.0)
    assert math.isnan(relative_stress_error(true, np.zeros_like(true)))
