"""Convex functions of the deviator of the strain, for yield surfaces that need not be round, and the return to them.

A gauge G is convex, grows in proportion to its argument and is the same in every order of the principal values: G <= L
is then a convex elastic domain around the axis of pressure, and every such domain has a gauge (Rockafellar 1970,
"Convex analysis", section 15). Sums of gauges, none of them negative, are gauges.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from pcnclaws.laws.base import Values
from pcnclaws.laws.operations import maximum, minimum, safe_sqrt, where

# Those that are added: the largest value and minus the smallest, whose sum is Tresca's hexagon, and with other shares
# Mohr-Coulomb's; the norm, which is round; the norms of the positive and of the negative values, which have no corners.
GAUGES = ("highest", "lowest", "round", "positive", "negative")
# All are 1 in pure shear, (1, 0, -1)/sqrt(2).
ROOT_2 = math.sqrt(2.0)


class Ordered(NamedTuple):
    """The largest, the middle and the smallest principal value of a deviator."""

    high: Any
    middle: Any
    low: Any


class Slopes(NamedTuple):
    """The gradient of a gauge in its principal values.

    high, low      what belongs to the largest and to the smallest value alone
    norm           times each value, and what belongs to positive and to negative ones, times each of them
    """

    high: Any
    low: Any
    norm: Any
    positive: Any
    negative: Any

    def smooth(self, value: Any) -> Any:
        """What each value has, as a function of that value."""
        return self.norm * value + self.positive * _above(value) + self.negative * _below(value)


def ordered(dev: Values) -> Ordered:
    """The principal values of a deviator, in order."""
    high, low = maximum(maximum(dev[0], dev[1]), dev[2]), minimum(minimum(dev[0], dev[1]), dev[2])
    larger, smaller = maximum(dev[0], dev[1]), minimum(dev[0], dev[1])
    return Ordered(high, maximum(smaller, minimum(larger, dev[2])), low)


def gauge(dev: Ordered, shares: Sequence[Any]) -> Any:
    """G = sum_k share_k G_k of the gauges in the order of GAUGES [-]; 1 in pure shear where the shares add up to 1."""
    norm, positive, negative = _norms(dev)
    each = (ROOT_2 * dev.high, -ROOT_2 * dev.low, norm, ROOT_2 * positive, ROOT_2 * negative)
    return sum(share * one for share, one in zip(shares, each, strict=True))


def slopes(dev: Ordered, shares: Sequence[Any], flows: Any) -> Slopes:
    """The gradient of the gauge, where something flows; anything finite elsewhere."""
    norm, positive, negative = (where(flows, one, 1.0) for one in _norms(dev))
    high, low, of_norm, of_positive, of_negative = shares
    return Slopes(
        ROOT_2 * high, -ROOT_2 * low, of_norm / norm, ROOT_2 * of_positive / positive, ROOT_2 * of_negative / negative
    )


def returned(dev: Values, limit: Any, shares: Sequence[Any], normal: Any) -> tuple[Any, Values]:
    """Whether a deviator is outside of G <= limit, and where it goes then: along the normal, then along its radius.

        s* = s - n g,   n = normal (G(s) - L)/|g|^2 at most,   g = dG/ds,   s' = s* min(1, L/G(s*))

    normal = 0 is the radial return; normal = 1 goes to the nearest point where the surface is flat, and to corners. As
    G is convex, s* is not inside of the surface, |s*| <= |s|, and s' is on it: strain only shrinks, and a second return
    finds nothing to do. A corner is where two values would change their order: they meet there.
    """
    at = ordered(dev)
    outside = gauge(at, shares) - limit
    flows = outside > 0.0
    excess = where(flows, outside, 0.0)
    slope = slopes(at, shares, flows)
    smooth = [slope.smooth(value) for value in at]
    gradient = (smooth[0] + slope.high, smooth[1], smooth[2] + slope.low)
    mean = sum(gradient) / 3.0
    steepness = sum((one - mean) * (one - mean) for one in gradient)
    # no value may turn around: what each loses of itself is at most all of it
    least = excess * (slope.norm + maximum(slope.positive, slope.negative))
    step = normal * excess / where(flows, maximum(steepness, least), 1.0)

    def moved(value: Any) -> Any:
        """Where a value goes that is neither the largest nor the smallest."""
        return value - step * (slope.smooth(value) - mean)

    high, middle, low = moved(at.high) - step * slope.high, moved(at.middle), moved(at.low) - step * slope.low
    top, bottom = where(middle > high, -0.5 * low, high), where(middle < low, -0.5 * high, low)
    reached = gauge(Ordered(top, -(top + bottom), bottom), shares)
    beyond = reached > limit
    scale = where(beyond, limit / where(beyond, reached, 1.0), 1.0)
    # each between the largest and the smallest: as a function of each value alone, whatever their order
    return flows, [scale * maximum(minimum(moved(value), top), bottom) for value in dev]


def _norms(dev: Ordered) -> tuple[Any, Any, Any]:
    """Of all values, of the positive and of the negative ones."""
    above, below = _above(dev.middle), _below(dev.middle)
    positive, negative = dev.high * dev.high + above * above, dev.low * dev.low + below * below
    return safe_sqrt(positive + negative), safe_sqrt(positive), safe_sqrt(negative)


def _above(x: Any) -> Any:
    return where(x > 0.0, x, 0.0 * x)


def _below(x: Any) -> Any:
    return where(x < 0.0, x, 0.0 * x)
