"""The scatter of observed positions: what is left of a residual when all that is smooth in time, or in space, is gone.

Each estimate is too large where the residual is not smooth enough, never too small where the errors of the positions
are independent: the smallest one is the best.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int64
from scipy.spatial import KDTree

# Orders of the differences in time: a low one needs fewer frames, a high one sees less of a curved path.
ORDERS = (2, 3, 4, 5)
# Median of the magnitude of a normal variable of unit variance.
NORMAL_MEDIAN = 0.6744897501960817
# Fewer differences than this say nothing.
FEWEST = 12
# An affine field has four numbers for each coordinate of a frame; twice as many markers tell it from their scatter.
AFFINE = 4


class Scatter(NamedTuple):
    """A standard deviation of observed coordinates.

    size    [m]
    number  of the differences that it was made from, inf where it was given
    known   what it was made from, in words
    """

    size: float
    number: float
    known: str

    @property
    def given(self) -> bool:
        """Whether the user knows it."""
        return bool(np.isinf(self.number))

    @property
    def largest(self) -> float:
        """What it could be by chance [m]: four standard errors of the variance of `number` differences more."""
        return self.size * float(np.sqrt(1.0 + 4.0 / np.sqrt(self.number)))


def given_scatter(noise: float) -> Scatter:
    """A scatter that the user knows [m]."""
    return Scatter(noise, np.inf, "observation.noise")


def scatter_of(
    time: Float[np.ndarray, " frames"],
    fields: tuple[Float[np.ndarray, "frames markers 3"], ...],
    place: Float[np.ndarray, "markers 3"],
) -> Scatter | None:
    """The smallest estimate of the scatter; None where frames and markers are too few for any.

    time    of the frames [s]
    fields  that hold the errors of the positions, and beside them what is smooth in time: the residual, the positions
            themselves [m]; NaN where a marker was not seen. The first one is smooth in space, too
    place   of the markers at the start [m]
    """
    differences = [_in_time(time, field, order) for field in fields for order in ORDERS]
    found = [Scatter(_deviation(one), len(one), "neighbouring frames") for one in differences if len(one) >= FEWEST]
    rest = _in_space(fields[0], place)
    if len(rest) >= FEWEST:
        found.append(Scatter(_deviation(rest), len(rest), "neighbouring markers"))
    return min(found, key=lambda one: one.largest, default=None)


def scatter_on_surface(
    residual: Float[np.ndarray, " points"],
    place: Float[np.ndarray, "points 3"],
    frame: Int64[np.ndarray, " points"],
    patch: Int64[np.ndarray, " points"],
) -> Scatter | None:
    """The scatter of points across a surface: differences of neighbours in a frame and a patch of the surface.

    None where points are too few. A residual that is smooth in space is nearly the same for neighbours.
    residual  distances of the points from the simulated surface [m]
    place     of the points [m]
    """
    if len(place) < FEWEST:
        return None
    apart = 10.0 * float(np.ptp(place, axis=0).max())  # points of another frame or patch are no neighbours
    lifted = np.column_stack((place, apart * frame, apart * patch))
    distance, found = (np.asarray(one)[:, 1] for one in KDTree(lifted).query(lifted, k=2))
    near = distance < apart
    if near.sum() < FEWEST:
        return None
    differences = (residual - residual[found])[near] / np.sqrt(2.0)
    return Scatter(_deviation(differences), len(differences), "neighbouring points")


def _deviation(differences: Float[np.ndarray, " differences"]) -> float:
    """Their standard deviation, by their median: an impact between two frames does not count."""
    return float(np.median(np.abs(differences)) / NORMAL_MEDIAN)


def _in_time(time: np.ndarray, field: np.ndarray, order: int) -> Float[np.ndarray, " differences"]:
    """Differences of each marker's seen positions that vanish for polynomials below `order`, of the variance of one."""
    found = [np.empty(0)]
    for track in np.swapaxes(field, 0, 1):
        seen = np.isfinite(track).all(1)
        if seen.sum() > order:
            moments = np.lib.stride_tricks.sliding_window_view(time[seen], order + 1)
            windows = np.lib.stride_tricks.sliding_window_view(track[seen], order + 1, axis=0)
            found.append(np.einsum("wco,wo->wc", windows, _divided(moments)).ravel())
    return np.concatenate(found)


def _divided(moments: Float[np.ndarray, "windows points"]) -> Float[np.ndarray, "windows points"]:
    """Weights of divided differences of uneven times, with squares that sum to 1."""
    apart = moments[:, :, None] - moments[:, None, :]
    apart[:, *np.diag_indices(moments.shape[1])] = 1.0
    weight = 1.0 / apart.prod(2)
    return weight / np.linalg.norm(weight, axis=1, keepdims=True)


def _in_space(field: np.ndarray, place: np.ndarray) -> Float[np.ndarray, " rest"]:
    """What an affine field of each frame leaves, scaled up by the freedom that it takes."""
    found = [np.empty(0)]
    basis = np.column_stack((np.ones(len(place)), place - place.mean(0)))
    for frame in field:
        seen = np.isfinite(frame).all(1)
        count = int(seen.sum())
        if count >= 2 * AFFINE:
            fitted = basis[seen] @ np.linalg.lstsq(basis[seen], frame[seen], rcond=1e-9)[0]
            found.append((frame[seen] - fitted).ravel() * np.sqrt(count / (count - AFFINE)))
    return np.concatenate(found)
