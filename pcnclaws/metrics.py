"""Errors of a predicted trajectory: pure functions of particle-first arrays.

NaN in the true positions marks a particle that was not observed in that frame; it does not count. A NaN in a
prediction is a failure, not a gap: it makes the error NaN. A frame without any observed particle does not count.
"""

import math

import numpy as np
from jaxtyping import Float

Positions = Float[np.ndarray, "frames particles 3"]
Stresses = Float[np.ndarray, "*states 3 3"]


def position_mse_by_frame(predicted: Positions, true: Positions) -> Float[np.ndarray, " frames"]:
    """Squared position error [m^2] of each frame, mean over the observed particles and the 3 coordinates.

    predicted, true  [m], (frames, particles, 3)
    returns          (frames,), NaN for a frame in which no particle was observed
    """
    squared = np.square(predicted.astype(np.float64) - true.astype(np.float64)).mean(2)
    observed = np.isfinite(true).all(2)
    count = observed.sum(1)
    total = np.where(observed, squared, 0.0).sum(1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def position_mse(predicted: Positions, true: Positions) -> float:
    """The error metric "MSE" [m^2]: mean over particles and coordinates, then over the frames.

    The frames are those at every 5th step, frame 0 included, wherever the data is ours: the arrays hold them.
    predicted, true  [m], (frames, particles, 3)
    raises           ValueError when no particle is observed in any frame
    """
    seen = np.isfinite(true).all(2).sum(1) > 0
    if not seen.any():
        raise ValueError("no particle is observed in any frame")
    return float(position_mse_by_frame(predicted[seen], true[seen]).mean())


def mse_sum(mse: float) -> float:
    """The same error with the three coordinates summed instead of averaged [m^2]."""
    return 3.0 * mse


def object_size(volume: Float[np.ndarray, " particles"]) -> float:
    """Cube root of the initial volume of the object [m].

    volume  initial volume of each particle [m^3], (particles,)
    """
    return float(volume.astype(np.float64).sum() ** (1.0 / 3.0))


def rms_percent(summed_mse: float, volume: Float[np.ndarray, " particles"]) -> float:
    """Root mean square distance between predicted and true particle, in percent of the object's size.

    summed_mse  mean squared distance [m^2], that is `mse_sum`
    volume      initial volume of each particle [m^3], (particles,)
    """
    return 100.0 * math.sqrt(summed_mse) / object_size(volume)


def relative_stress_error(stress: Stresses, true_stress: Stresses) -> float:
    """Relative stress error |tau - tau_true| / |tau_true| [-] over many states.

    The ratio of two sums of Frobenius norms over all states, so that the nearly stress-free ones, whose own
    ratio says nothing, weigh little.

    stress, true_stress  Kirchhoff stress of the same states [Pa], (..., 3, 3)
    returns              NaN when the true stress vanishes everywhere
    """
    difference = np.linalg.norm(stress.astype(np.float64) - true_stress, axis=(-2, -1)).sum()
    size = np.linalg.norm(true_stress.astype(np.float64), axis=(-2, -1)).sum()
    return float(difference / size) if size > 0.0 else math.nan
