"""Orders of convergence from errors on several grids, the time step proportional to the grid spacing."""

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import NamedTuple

# Orders are looked for between these.
LOWEST, HIGHEST = 0.05, 8.0


class GridError(NamedTuple):
    """The error on a grid of `spacing` [m]."""

    spacing: float
    error: float


def order_of(coarse: GridError, fine: GridError, reference: float = 0.0) -> float | None:
    """The order p of an error C h^p, None where no order explains both errors.

    reference  spacing of the grid that the errors are measured against, whose own error is C reference^p:
               what is measured is C (h^p - reference^p). 0 for errors against an exact answer.
    """
    if not (fine.error > 0.0 and math.isfinite(coarse.error) and coarse.error > 0.0):
        return None
    ratio = math.log(coarse.error / fine.error)

    def excess(p: float) -> float:
        shares = [grid.spacing**p - reference**p for grid in (coarse, fine)]
        return math.log(shares[0] / shares[1]) - ratio

    return _root(excess)


def error_of_reference(fine: GridError, order: float, reference: float) -> float:
    """The reference's own error C reference^p, from that of a coarser grid which is measured against it."""
    return fine.error * reference**order / (fine.spacing**order - reference**order)


def orders_of(errors: Sequence[GridError], reference: float = 0.0) -> list[float | None]:
    """The orders between neighbours in a series from coarse to fine."""
    return [order_of(coarse, fine, reference) for coarse, fine in pairwise(errors)]


def _root(excess: Callable[[float], float]) -> float | None:
    """Where a growing function of the order is zero, by bisection; None if it is not between the bounds."""
    low, high = LOWEST, HIGHEST
    if excess(low) > 0.0 or excess(high) < 0.0:
        return None
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if excess(middle) < 0.0 else (low, middle)
    return 0.5 * (low + high)
