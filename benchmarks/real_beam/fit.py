"""The law, release time and place of the clamp from a recording, with intervals that know of alike residuals."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from benchmarks.real_beam.law import strengths
from benchmarks.real_beam.measured import Recording
from benchmarks.real_beam.runs import YOUNG
from benchmarks.real_beam.scene import LENGTH, WIDTH
from benchmarks.real_beam.surrogate import LATE, Family, Law

# Lags of the covariance of the scores [s]; x and z of the markers are compared, since the motion is in their plane.
LAGS, IN_PLANE = 1.0, (0, 2)
NAMES = ("youngs_modulus", "strength", "exponent", "release", "face", "axis", "held", "caught", "stiffening")
SCALES = np.array((YOUNG, 0.3, 0.3, 0.01, 0.01, 0.01, 1e-3, 0.1, 0.02))


@dataclass(frozen=True)
class Fit:
    """Estimates in the order of NAMES.

    Long-term E [Pa], strength of the first Maxwell element and exponent of the others [-] (law.py), release [s], z of
    the face of the clamp and x of the axis of the beam in the frame of the recording [m]; how far the tip hung before
    the release [m], the share of the sag from which the free motion begins, and by how much the beam is stiffer when it
    sags by its own weight [-].

    free      names of what was estimated; the others were given
    half      half the widths of the 95 % intervals; 0 for what was given
    residual  measured minus simulated [m], from the release on, (frames, 3, 2)
    naive     half the widths as they were with white noise
    """

    values: np.ndarray
    free: tuple[str, ...]
    half: np.ndarray
    residual: np.ndarray
    naive: np.ndarray

    @property
    def rms(self) -> float:
        return float(np.sqrt(np.mean(self.residual**2)))

    def plain(self) -> dict[str, Any]:
        """As plain values."""
        rows = zip(NAMES, self.values.tolist(), self.half.tolist(), self.naive.tolist(), strict=True)
        return {
            "parameters": {
                name: {"estimate": value, "interval_95": [value - half, value + half], "white_noise_half": naive}
                for name, value, half, naive in rows
                if name in self.free
            },
            "rms": self.rms,
        }


def simulated(recording: Recording, family: Family, values: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Displacements of the markers of the tip at times of the recording's clock [m], (times, 3, 3)."""
    places = recording.places(float(values[4]), float(values[5]))
    return moved(family, places, values, time, recording.onset)


def moved(family: Family, places: np.ndarray, values: np.ndarray, time: np.ndarray, onset: float) -> np.ndarray:
    """Displacements of points of the tip from where they were held [m], (times, points, 3).

    The motion is linear enough that a start elsewhere than straight is a share of the motion from there. Where it is
    caught, the tip falls from straight until it is as deep as the free motion that follows.

    time   increasing [s]
    onset  when the tip begins to move [s]
    """
    modulus, strength, exponent, release, _, _, held, caught, stiffening = (float(value) for value in values)
    law = Law(modulus, strengths(strength, exponent), stiffening)
    share = 1.0 + held / float(family.height(np.array([LATE]), law)[0])
    free = family.displacement(time - release, places, law)
    if caught == 0.0:
        return share * free
    rest = family.displacement(np.array([LATE]), places, law)
    after = (1.0 - caught) * free + caught * (time > release)[:, None, None] * rest
    falling = family.displacement(time - onset, places, law)
    falls = np.logical_and.accumulate((time <= release) | (falling[:, 0, 0] > after[:, 0, 0]))
    return share * np.where(falls[:, None, None], falling, after)


def start_of(recording: Recording, law: tuple[float, float, float]) -> np.ndarray:
    """Where a fit begins: the first marker near the upper edge of the tip, let go from straight.

    law  long-term E [Pa], strength and exponent [-]
    """
    placed = recording.rest[0, [2, 0]] - (LENGTH, 0.5 * WIDTH)
    return np.array((*law, recording.onset, *placed, 0.0, 0.0, 0.0))


def fit(recording: Recording, family: Family, start: np.ndarray, free: tuple[str, ...]) -> Fit:
    """Least squares over all frames from the release on.

    start  values in the order of NAMES
    free   names of those that are estimated
    """
    which = [NAMES.index(name) for name in free]
    begin = recording.first_moved
    time, measured = recording.time[begin:], (recording.tip - recording.rest)[begin:, :, IN_PLANE]

    def residual(scaled: np.ndarray) -> np.ndarray:
        values = start.copy()
        values[which] = scaled * SCALES[which]
        return (measured - simulated(recording, family, values, time)[:, :, IN_PLANE]).ravel()

    found = least_squares(residual, start[which] / SCALES[which], method="lm")
    values = start.copy()
    values[which] = found.x * SCALES[which]
    left = found.fun.reshape(measured.shape)
    lags = round(LAGS / float(np.median(np.diff(time))))
    widths = np.zeros((2, len(NAMES)))
    widths[:, which] = np.stack(_half_widths(found.jac, left, lags)) * SCALES[which]
    return Fit(values, free, widths[0], left, widths[1])


def _half_widths(jacobian: np.ndarray, residual: np.ndarray, lags: int) -> tuple[np.ndarray, np.ndarray]:
    """Half the 95 % intervals of least squares whose residuals are alike in time and from marker to marker.

    The scores J^T r of the frames have the covariance of Newey and West, with Bartlett's weights; critical values of
    Kiefer and Vogelsang for lags that are a share b of the frames. Beside it the interval of white noise.

    source  Newey and West 1987, Econometrica 55, 703; Kiefer and Vogelsang 2005, Econometric Theory 21, 1130, table 1
    """
    frames = len(residual)
    each = jacobian.reshape(frames, -1, jacobian.shape[1])
    scores = np.einsum("tmk,tm->tk", each, residual.reshape(frames, -1))
    middle = scores.T @ scores
    for lag in range(1, lags + 1):
        moved = scores[lag:].T @ scores[:-lag]
        middle += (1.0 - lag / (lags + 1.0)) * (moved + moved.T)
    inverse = np.linalg.inv(jacobian.T @ jacobian)
    share = lags / frames
    critical = 1.96 + 2.9694 * share + 0.4160 * share**2 - 0.5324 * share**3
    robust = critical * np.sqrt(np.diag(inverse @ middle @ inverse))
    spread = float(np.sum(residual**2)) / (residual.size - jacobian.shape[1])
    return robust, 1.96 * np.sqrt(spread * np.diag(inverse))
