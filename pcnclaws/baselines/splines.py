"""Cubic splines of one variable with trainable values and slopes, and their knots."""

import math
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

Values = Float[Tensor, "*points"]
Knots = Float[Tensor, " knots"]


class Place(NamedTuple):
    """Where points lie among knots: number of the interval, share t of it (0 to 1), its width, distance beyond an end.

    Outside of the knots t is 0 or 1 and `beyond` what is left: a spline goes on as a straight line there.
    """

    interval: Tensor
    t: Values
    width: Values
    beyond: Values


def knots_around_one(count: int, reach: float, crowding: float = 6.0) -> Float[Tensor, " knots"]:
    """An odd number of knots exp(reach sinh(c u)/sinh(c)), u from -1 to 1: stretches, close together around 1.

    Stiff materials strain by thousandths, soft ones by tens of percent: the widths grow from the middle knot, which
    is 1, to the ends exp(-reach) and exp(reach).
    """
    if count < 3 or count % 2 == 0:
        raise ValueError(f"{count} knots have no middle one; accepted: an odd number from 3")
    u = torch.linspace(-1.0, 1.0, count, dtype=torch.float64)
    logarithms = reach * torch.sinh(crowding * u) / math.sinh(crowding)
    logarithms[count // 2] = 0.0
    return logarithms.exp()


def locate(x: Values, knots: Knots) -> Place:
    """The interval of each point: knots[i] <= x < knots[i + 1], the first or the last one for points outside."""
    interval = torch.searchsorted(knots, x.detach().contiguous(), right=True) - 1
    interval = interval.clamp(0, len(knots) - 2)
    low, width = knots[interval], (knots[1:] - knots[:-1])[interval]
    inside = torch.minimum(torch.maximum(x, knots[0]), knots[-1])
    return Place(interval, (inside - low) / width, width, x - inside)


def cubic(place: Place, values: Knots, slopes: Knots) -> Values:
    """The cubic Hermite spline through `values` with `slopes` at the knots, a straight line beyond the ends."""
    y0, y1, m0, m1 = _ends(place, values, slopes)
    t, t2 = place.t, place.t.square()
    rise = t2 * (3.0 - 2.0 * t)
    inside = y0 + rise * (y1 - y0) + place.width * (t * (1.0 - t).square() * m0 - t2 * (1.0 - t) * m1)
    return inside + place.beyond * _end_slope(place, slopes)


def cubic_slope(place: Place, values: Knots, slopes: Knots) -> Values:
    """Its derivative."""
    y0, y1, m0, m1 = _ends(place, values, slopes)
    t = place.t
    return 6.0 * t * (1.0 - t) * (y1 - y0) / place.width + (1.0 - t) * (1.0 - 3.0 * t) * m0 + t * (3.0 * t - 2.0) * m1


def cubic_integral(place: Place, values: Knots, slopes: Knots, knots: Knots) -> Values:
    """Its integral from the first knot."""
    width = knots[1:] - knots[:-1]
    whole = width * 0.5 * (values[:-1] + values[1:]) + width.square() / 12.0 * (slopes[:-1] - slopes[1:])
    before = torch.cat((whole.new_zeros(1), whole.cumsum(0)))[place.interval]
    y0, y1, m0, m1 = _ends(place, values, slopes)
    t = place.t
    rise = t.pow(3) - 0.5 * t.pow(4)
    first = 0.5 * t.square() - 2.0 / 3.0 * t.pow(3) + 0.25 * t.pow(4)
    second = t.pow(3) / 3.0 - 0.25 * t.pow(4)
    inside = place.width * (t * y0 + rise * (y1 - y0) + place.width * (first * m0 - second * m1))
    at_end = torch.where(place.beyond > 0.0, values[-1], values[0])
    return before + inside + place.beyond * (at_end + 0.5 * place.beyond * _end_slope(place, slopes))


def linear(place: Place, values: Knots) -> Values:
    """The straight lines through `values` at the knots, the last of them going on beyond the ends."""
    low, high = values[place.interval], values[place.interval + 1]
    return low + (place.t + place.beyond / place.width) * (high - low)


def _ends(place: Place, values: Knots, slopes: Knots) -> tuple[Values, Values, Values, Values]:
    i = place.interval
    return values[i], values[i + 1], slopes[i], slopes[i + 1]


def _end_slope(place: Place, slopes: Knots) -> Values:
    return torch.where(place.beyond > 0.0, slopes[-1], slopes[0])
