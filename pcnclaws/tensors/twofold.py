"""Numbers to twice the digits of float64, each the sum of two: for sums of products that cancel.

source  Dekker 1971, "A floating-point technique for extending the available precision"
"""

from typing import NamedTuple

from torch import Tensor

# of float64: what a number keeps of its 53 digits when it is multiplied by this and the excess is taken away, is 26
SPLITTER = 2.0**27 + 1.0


class Twofold(NamedTuple):
    """high + low, where low is at most the rounding of high; tensors of float64, of one shape."""

    high: Tensor
    low: Tensor

    def plus(self, other: "Twofold") -> "Twofold":
        total = sum_of(self.high, other.high)
        return sum_of(total.high, total.low + (self.low + other.low))

    def times(self, factor: Tensor) -> "Twofold":
        whole = product_of(self.high, factor)
        return sum_of(whole.high, self.low * factor + whole.low)


def sum_of(a: Tensor, b: Tensor) -> Twofold:
    """a + b without rounding."""
    high = a + b
    part = high - a
    return Twofold(high, (a - (high - part)) + (b - part))


def product_of(a: Tensor, b: Tensor) -> Twofold:
    """a b without rounding, for numbers up to 1e300."""
    high = a * b
    (a_high, a_low), (b_high, b_low) = _split(a), _split(b)
    return Twofold(high, ((a_high * b_high - high) + a_high * b_low + a_low * b_high) + a_low * b_low)


def _split(a: Tensor) -> tuple[Tensor, Tensor]:
    high = SPLITTER * a
    high = high - (high - a)
    return high, a - high
