"""What is estimated in place of a bounded physical number: a coordinate that may take any value.

A step of an optimiser in the coordinate can never leave the bounds, and a relative change of a modulus is the same step
whatever its size.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.special import expit, logit

# How deep inside its bounds a guess is put, as a share of the interval: at the bound itself the coordinate is infinite.
MARGIN = 0.05


@dataclass(frozen=True)
class Transform:
    """The coordinate u of a number in (lower, upper): value = g^-1(g(lower) + (g(upper) - g(lower)) sigmoid(u)).

    logarithmic  g is the logarithm, else the identity
    """

    lower: float
    upper: float
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

    def coordinate(self, value: float) -> float:
        """The coordinate of a number."""
        return value / self.scale

    def inside(self, value: float) -> float:
        """The number itself."""
        return value


# Of any solid or granular material that the laws are for. Poisson's ratio stays away from 0.5, where the stiffness
# against compression is infinite.
TRANSFORMS = {
    "youngs_modulus": Transform(1e2, 1e9, logarithmic=True),
    "poissons_ratio": Transform(-0.4, 0.49),
    "friction_angle": Transform(0.5, 75.0),
    "yield_stress": Transform(1.0, 1e7, logarithmic=True),
}
