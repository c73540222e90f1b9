"""Transforms of bounded physical numbers to coordinates that may take any value.

A step of an optimiser in the coordinate can never leave the bounds, and a relative change of a modulus is the same step
whatever its size.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.special import expit, logit

from pcnclaws.laws.parameters import Parameter

# How deep inside its bounds a guess is put, as a share of the interval: at the bound itself the coordinate is infinite.
MARGIN = 0.05
# A search stays within these coordinates: at 4, 2 % of the interval are left.
FURTHEST = 4.0
# Longest step of a number without bounds, in its scale.
LONGEST_FREE = 2.0


@dataclass(frozen=True)
class Transform:
    """The coordinate u of a number in (lower, upper): value = g^-1(g(lower) + (g(upper) - g(lower)) sigmoid(u)).

    logarithmic   g is the logarithm, else the identity
    longest_step  that a search takes at once, of g(value)
    """

    lower: float
    upper: float
    longest_step: float
    logarithmic: bool = False

    def value(self, coordinate: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """The numbers of coordinates."""
        scaled = self._low + self._span * expit(coordinate)
        return np.exp(scaled) if self.logarithmic else scaled

    def slope(self, coordinate: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """d value / d coordinate."""
        share = expit(coordinate)
        slope = self._span * share * (1.0 - share)
        return slope * self.value(coordinate) if self.logarithmic else slope

    def log_density(self, coordinate: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """The logarithm of the density of coordinates for which g(value) is uniform, up to a constant."""
        return np.log(expit(coordinate)) + np.log(expit(-coordinate))

    def reach(self, coordinate: float) -> tuple[float, float]:
        """How far a search may go at once: to the longest step, and not so near to a bound that it would stay there."""
        place = self._low + self._span * float(expit(coordinate))
        ends = np.clip((place - self.longest_step - self._low, place + self.longest_step - self._low), 0.0, self._span)
        low, high = (float(np.clip(logit(end / self._span), -FURTHEST, FURTHEST)) for end in ends)
        return min(low - coordinate, 0.0), max(high - coordinate, 0.0)

    def coordinate(self, value: float) -> float:
        """The coordinate of a number strictly inside the bounds."""
        return float(logit((self._g(value) - self._low) / self._span))

    def inside(self, value: float) -> float:
        """The number itself, or the nearest one that keeps MARGIN from both bounds where it is nearer to one."""
        low, high = (self._low + self._span * share for share in (MARGIN, 1.0 - MARGIN))
        if value > 0.0 or not self.logarithmic:
            place = self._g(value)
            if low <= place <= high:
                return value
            low = high if place > high else low
        return math.exp(low) if self.logarithmic else low

    @property
    def _low(self) -> float:
        return self._g(self.lower)

    @property
    def _span(self) -> float:
        return self._g(self.upper) - self._low

    def _g(self, value: float) -> float:
        return math.log(value) if self.logarithmic else value


@dataclass(frozen=True)
class Free:
    """A number without bounds, such as a velocity, in units of `scale`."""

    scale: float = 1.0

    def value(self, coordinate: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """The numbers of coordinates."""
        return self.scale * coordinate

    def slope(self, coordinate: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """d value / d coordinate."""
        return np.full_like(coordinate, self.scale)

    def log_density(self, coordinate: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """A uniform density, up to a constant."""
        return np.zeros_like(coordinate)

    def reach(self, coordinate: float) -> tuple[float, float]:
        """How far a search may go at once: a few units of the scale."""
        return -LONGEST_FREE, LONGEST_FREE

    def coordinate(self, value: float) -> float:
        """The coordinate of a number."""
        return value / self.scale

    def inside(self, value: float) -> float:
        """The number itself."""
        return value


def transform_of(parameter: Parameter) -> Transform:
    """The coordinate of a physical parameter."""
    return Transform(*parameter.searched, parameter.longest_step, parameter.logarithmic)
