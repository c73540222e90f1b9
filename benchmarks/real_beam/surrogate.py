"""Motions of the tip for laws near that of a simulated one: the simulation, and what an oscillator says of the change.

A mass on a spring with the law's Maxwell elements is fitted to the height of the simulated tip. For another law the
oscillator's change of height is added, and the rest of the tip follows the height as it does in the simulation. At the
law of the simulation itself the motion is the simulated one, so that a simulation at each estimate makes it exact.

source  Bandler et al. 1994, "Space mapping technique for electromagnetic optimization"
"""

from collections.abc import Mapping
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

from benchmarks.real_beam.law import RELAXATION_TIMES
from benchmarks.real_beam.runs import FIRST_GUESS, tip_of
from benchmarks.real_beam.scene import LENGTH

# Of the end of a run, whose difference from the oscillator goes on after it [s].
TAIL = 0.3
# When all has come to rest [s]; nearly so, and the steps of a motion with a cubic spring.
LATE, SETTLED, STEP = 1e3, 6.0, 1e-3
# The deflection at which a cubic spring is stated [m]: the sag of the beam's own weight.
STIFFENED_AT = 6.6e-3


class Oscillator(NamedTuple):
    """A mass on a spring beside Maxwell elements, pulled by a constant force from time 0 on.

        x'' + d x' + w^2 (x + sum_k g_k (x - q_k)) = -w^2 sag,   q_k' = (x - q_k) / t_k,   w = 2 pi frequency

    frequency  of mass and long-term spring [Hz]
    sag        in the long term [m]
    drag       of what else damps, such as the grid, d [1/s]
    """

    frequency: float
    sag: float
    drag: float

    def height(self, time: np.ndarray, moduli: np.ndarray) -> np.ndarray:
        """x at times after the release [m], (times,), 0 before it; moduli: g_k [-], (elements,)."""
        times, square = np.asarray(RELAXATION_TIMES), (2.0 * np.pi * self.frequency) ** 2
        matrix = np.zeros((2 + len(times), 2 + len(times)))
        matrix[0, 1], matrix[1, 1] = 1.0, -self.drag
        matrix[1, 0], matrix[1, 2:] = -square * (1.0 + np.sum(moduli)), square * moduli
        matrix[2:, 0], matrix[2:, 2:] = 1.0 / times, -np.diag(1.0 / times)
        rates, modes = np.linalg.eig(matrix)
        rest = np.full(len(matrix), -self.sag)
        rest[1] = 0.0
        shares = np.linalg.solve(modes, -rest.astype(complex))
        return -self.sag + np.real(np.exp(np.clip(time, 0.0, None)[:, None] * rates) * modes[0] @ shares)

    def stiffened(self, time: np.ndarray, moduli: np.ndarray, share: float) -> np.ndarray:
        """The same with a cubic spring, w^2 (x + share x^3 / x_1^2), by symplectic Euler [m], (times,).

        share  of the stiffness, at x_1 = STIFFENED_AT [-]
        """
        steps = int(min(float(time.max()), SETTLED) / STEP) + 2
        square, follow = (2.0 * np.pi * self.frequency) ** 2, [-np.expm1(-STEP / t) for t in RELAXATION_TIMES]
        weights, within = moduli.tolist(), [0.0] * len(follow)
        height, velocity, found = 0.0, 0.0, np.zeros(steps)
        for step in range(1, steps):
            spring = height + self.sag + share * height**3 / STIFFENED_AT**2
            elements = sum(g * (height - q) for g, q in zip(weights, within, strict=True))
            velocity -= STEP * (self.drag * velocity + square * (spring + elements))
            height += STEP * velocity
            within = [q + f * (height - q) for q, f in zip(within, follow, strict=True)]
            found[step] = height
        return np.interp(time, STEP * np.arange(steps), found)

    def with_modulus(self, ratio: float) -> "Oscillator":
        """The one whose long-term modulus is so many times as large."""
        return self._replace(frequency=self.frequency * ratio**0.5, sag=self.sag / ratio)


class Law(NamedTuple):
    """What a beam is made of.

    modulus     long-term E [Pa]
    moduli      of the Maxwell elements over the long-term one [-]
    stiffening  by how much the beam is stiffer at a deflection of STIFFENED_AT [-]
    """

    modulus: float
    moduli: np.ndarray
    stiffening: float = 0.0


class Family:
    """The motion of a beam for all laws around the simulated one."""

    def __init__(self, row: Mapping[str, Any]) -> None:
        """row: what runs.tips gave for a beam."""
        self.tip, self.modulus = tip_of(row), float(row["youngs_modulus"])
        self.moduli, self.weight = np.asarray(row["strengths"]), float(row["weight"])

    @cached_property
    def oscillator(self) -> Oscillator:
        """With the law of the run, fitted to its height."""
        time, height = self.tip.time, self.tip.height

        def left(scaled: np.ndarray) -> np.ndarray:
            return 1e3 * (Oscillator(scaled[0], 1e-3 * scaled[1], scaled[2]).height(time, self.moduli) - height)

        start = (FIRST_GUESS[self.weight], -1e3 * float(height[-1]), 0.3)
        frequency, sag, drag = least_squares(left, start, x_scale=(0.1, 0.1, 1.0)).x.tolist()
        return Oscillator(frequency, 1e-3 * sag, drag)

    @cached_property
    def _following(self) -> np.ndarray:
        """Changes of middle and gradient per height and per its square, (2, 12)."""
        height = self.tip.height
        return np.linalg.lstsq(np.stack((height, height**2), axis=1), self._changes, rcond=None)[0]

    @property
    def _changes(self) -> np.ndarray:
        tip = self.tip
        return np.concatenate((tip.middle - tip.middle[0], (tip.gradient - np.eye(3)).reshape(-1, 9)), axis=1)

    @cached_property
    def _left(self) -> tuple[CubicSpline, np.ndarray]:
        """What the oscillator leaves of the run over time, and at its end, (12,)."""
        time = self.tip.time
        left = self._changes - self._followed(self.oscillator.height(time, self.moduli))
        return CubicSpline(time, left), left[time > time[-1] - TAIL].mean(0)

    def _followed(self, height: np.ndarray) -> np.ndarray:
        return np.stack((height, height**2), axis=1) @ self._following

    def height(self, time: np.ndarray, law: Law) -> np.ndarray:
        """Of the middle of the tip's face [m], (times,)."""
        return self._of(time, law)[:, 0]

    def displacement(self, time: np.ndarray, places: np.ndarray, law: Law) -> np.ndarray:
        """Displacements of points of the tip [m], (times, points, 3).

        time    after the release [s]
        places  in the frame of the undeformed beam [m], (points, 3)
        """
        total = self._of(time, law)
        offset = places - np.array((0.0, 0.0, LENGTH))
        return total[:, None, :3] + np.einsum("tij,pj->tpi", total[:, 3:].reshape(-1, 3, 3), offset)

    def _of(self, time: np.ndarray, law: Law) -> np.ndarray:
        """Changes of middle and gradient, (times, 12)."""
        spline, end = self._left
        last = self.tip.time[-1]
        left = np.where((time > last)[:, None], end, spline(np.clip(time, 0.0, last)))
        changed = self.oscillator.with_modulus(law.modulus / self.modulus)
        height = changed.height(time, law.moduli)
        if law.stiffening:
            height += changed.stiffened(time, law.moduli, law.stiffening) - changed.stiffened(time, law.moduli, 0.0)
        found = left + self._followed(height)
        found[time <= 0.0] = 0.0
        return found
