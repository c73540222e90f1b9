"""Motions of the tip between simulated ones: by scaling in E, and by interpolation in viscosity and gravity.

In units of length L and time L sqrt(rho/E) the motion depends on rho g L / E and eta / sqrt(E rho) alone, and so do
grid and step, whose length follows sqrt(rho/E). Three runs of different eta, and one of another E, give it for all E
nearby.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from benchmarks.real_beam.runs import FIRST_GUESS, SOFTER, VISCOSITIES, YOUNG, ringing, tip_of
from benchmarks.real_beam.scene import LENGTH, Tip

# Of the end of a run that it is continued from [s], and the guess of the frequency with the heaviest weight [Hz].
TAIL, SLOWEST = 1.5, 3.3


@dataclass(frozen=True)
class Continued:
    """A run as a function of time, which rings on after its end as it did before."""

    tip: Tip
    frequency: float

    @cached_property
    def values(self) -> np.ndarray:
        """Middle and gradient as changes, (frames, 12)."""
        tip = self.tip
        return np.concatenate((tip.middle - tip.middle[0], (tip.gradient - np.eye(3)).reshape(-1, 9)), axis=1)

    @cached_property
    def _spline(self) -> CubicSpline:
        return CubicSpline(self.tip.time, self.values)

    @cached_property
    def _tail(self) -> tuple[float, float, np.ndarray]:
        """Angular frequency and decay [1/s], and the constant, cosine and sine of each value, (3, 12)."""
        time = self.tip.time
        end = time > time[-1] - TAIL
        _, frequency, damping = ringing(time[end], self.values[end, 0], self.frequency)
        omega, decay = 2.0 * np.pi * frequency, 2.0 * np.pi * frequency * damping
        basis = _basis(time[end], omega, decay)
        return omega, decay, np.linalg.lstsq(basis, self.values[end], rcond=None)[0]

    @property
    def decay(self) -> float:
        """Of its oscillation [1/s]."""
        return self._tail[1]

    @property
    def rest(self) -> np.ndarray:
        """Changes that it comes to, (12,)."""
        return self._tail[2][0]

    def __call__(self, time: np.ndarray) -> np.ndarray:
        """Changes at times after the release [s], 0 before it, (times, 12)."""
        omega, decay, shares = self._tail
        found = self._spline(np.clip(time, 0.0, self.tip.time[-1]))
        found[time <= 0.0] = 0.0
        late = time > self.tip.time[-1]
        found[late] = _basis(time[late], omega, decay) @ shares
        return found


class Family:
    """The motion of a beam for all E and viscosities around the simulated ones."""

    def __init__(self, weight: float, rows: Sequence[Mapping[str, Any]]) -> None:
        """weight: [kg]; rows: what runs.tips gave for it."""
        guess = FIRST_GUESS.get(weight, SLOWEST)
        *self.runs, self.softer = (Continued(tip_of(row), guess) for row in rows)
        self.viscosities = np.asarray(VISCOSITIES[weight])

    def displacement(self, time: np.ndarray, places: np.ndarray, modulus: float, viscosity: float) -> np.ndarray:
        """Displacements of points of the tip [m], (times, points, 3).

        time       after the release [s]
        places     in the frame of the undeformed beam [m], (points, 3)
        modulus    E [Pa]
        viscosity  [Pa s]
        """
        faster = np.sqrt(modulus / YOUNG)
        scaled, own = time * faster, viscosity / faster
        total = self._of_viscosity(scaled, own) + (YOUNG / modulus - 1.0) * self._of_gravity(scaled, own)
        offset = places - np.array((0.0, 0.0, LENGTH))
        return total[:, None, :3] + np.einsum("tij,pj->tpi", total[:, 3:].reshape(-1, 3, 3), offset)

    def _of_viscosity(self, time: np.ndarray, viscosity: float) -> np.ndarray:
        """Changes at the E of the runs, (times, 12): of the two nearest runs, each with its oscillation damped anew."""
        upper, share, decay = self._between(viscosity)
        share = float(np.clip(share, 0.0, 1.0))
        total = np.zeros((len(time), 12))
        for weight, run in ((1.0 - share, self.runs[upper - 1]), (share, self.runs[upper])):
            total += weight * _damped(run(time), run.rest, time, run.decay - decay)
        return total

    def _of_gravity(self, time: np.ndarray, viscosity: float) -> np.ndarray:
        """The derivative of the changes with respect to the logarithm of gravity, (times, 12)."""
        middle, more = self.runs[1], YOUNG / SOFTER - 1.0
        slope = (self.softer(time / np.sqrt(SOFTER / YOUNG)) - middle(time)) / more
        return _damped(slope, (self.softer.rest - middle.rest) / more, time, middle.decay - self._between(viscosity)[2])

    def _between(self, viscosity: float) -> tuple[int, float, float]:
        """The upper of the two nearest runs, the share of it, and the decay at this viscosity [1/s], all linear."""
        decays = [run.decay for run in self.runs]
        upper = int(np.clip(np.searchsorted(self.viscosities, viscosity), 1, len(decays) - 1))
        low, high = self.viscosities[upper - 1 : upper + 1]
        share = float((viscosity - low) / (high - low))
        return upper, share, decays[upper - 1] + share * (decays[upper] - decays[upper - 1])


def _damped(values: np.ndarray, rest: np.ndarray, time: np.ndarray, less: float) -> np.ndarray:
    """Values whose distance from rest decays by so much less [1/s]."""
    return rest + (values - rest) * np.exp(less * np.clip(time, 0.0, None))[:, None]


def _basis(time: np.ndarray, omega: float, decay: float) -> np.ndarray:
    envelope = np.exp(-decay * time)
    return np.stack((np.ones_like(time), envelope * np.cos(omega * time), envelope * np.sin(omega * time)), axis=1)
