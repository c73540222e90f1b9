"""Discrepancy of a model that is wrong: what it leaves of a motion, as an error that is alike in time and in space.

A wrong grid, wall or transfer leaves no white noise but patterns: neighbouring markers, and one marker at neighbouring
times, are wrong alike. However many positions are seen, there are only so many independent patterns, and an estimate
averages over these alone. Size and reach of the patterns are taken from the residual: the error of the model is a
Gaussian process with the variance of each frame and the correlation exp(-|t - t'| / time - |x - x'| / length)
(Kennedy and O'Hagan 2001, "Bayesian calibration of computer models"), the same for the three coordinates.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import KDTree
from scipy.spatial.distance import cdist
from scipy.stats import t as student

from pcnclaws.data.observation import Observation
from pcnclaws.estimation.scatter import FEWEST

# Normal quantile of a two-sided interval of 95 %.
QUANTILE_95 = 1.959963984540054
# Reaches that are tried, as shares of the duration and of the size of the body.
SHORTEST, LONGEST, TRIED = 1e-2, 4.0, 60
# Pairs of markers are sorted by distance into so many classes, up to the size of the body.
CLASSES = 12
# Neighbours are alike where the sum of their products is so many times what it is by chance; pairs that are the nearest
# of each other count twice, so that these are three standard errors.
CHANCE = 4.0
# By how much wider than those of the process intervals are. A wrong grid errs more in the ways of the unknowns than in
# others, as if it had a stiffness of its own: with this margin, and no smaller one, intervals hold the five numbers of
# elasticity_1 and plasticine_1 of docs/estimation_results.md whose motion has half the grid spacing.
MARGIN = 2.3
# A frame whose residual is smaller than this share of that of all has no pattern of its own.
SMALLEST_SHARE = 1e-3


@dataclass(frozen=True)
class Discrepancy:
    """The error of a model, as far as its residual tells.

    size      root mean square [m]
    time      over which it is alike [s]
    length    over which it is alike [m]
    patterns  how many of its values are independent, of the three coordinates together
    of_frame  standard deviation in each frame [m], (frames,)
    seen      where a marker was, (frames, markers)
    in_time   correlation of frames [-], (frames, frames)
    in_space  correlation of markers [-], (markers, markers)
    margin    by how much wider than those of the process intervals are [-]
    """

    size: float
    time: float
    length: float
    patterns: float
    of_frame: Float[np.ndarray, " frames"]
    seen: Bool[np.ndarray, "frames markers"]
    in_time: Float[np.ndarray, "frames frames"]
    in_space: Float[np.ndarray, "markers markers"]
    margin: float = MARGIN

    def projected(self, jacobian: Float[np.ndarray, "unknowns rows"]) -> Float[np.ndarray, "unknowns unknowns"]:
        """J Sigma J^T of the covariance Sigma of the rows [m^4].

        The fit takes up as many patterns as there are unknowns, which the residual lacks: the variance is that of the
        other ones, and intervals are those of Student. Infinite where no pattern is left.
        """
        freedom = self.patterns - len(jacobian)
        if freedom < 1.0:
            return np.full((len(jacobian), len(jacobian)), np.inf)
        wide = self.margin**2 * self.patterns / freedom * (float(student.ppf(0.975, freedom)) / QUANTILE_95) ** 2
        field = np.stack([_field(row, self.seen) for row in jacobian]) * self.of_frame[:, None, None]
        spread = np.einsum("fg,agcn->afcn", self.in_time, field)
        spread = spread @ self.in_space
        count = len(jacobian)
        return wide * field.reshape(count, -1) @ spread.reshape(count, -1).T


def is_pattern(observation: Observation, residual: Float[np.ndarray, " rows"]) -> bool:
    """Whether a residual is alike for neighbouring markers of a frame, more than white errors are by chance.

    Each pair of neighbours counts once, however often it is seen: the error of the first frame, where a marker is put
    on the body, is in all of its frames, and in none of its neighbour's.
    """
    place, seen = observation.places, observation.seen
    if len(place) < 2:
        return False
    near = np.asarray(KDTree(place).query(place, k=2)[1])[:, 1]
    field = _field(residual, seen)
    both = seen & seen[:, near] & (np.square(field).sum((1, 2)) > 0.0)[:, None]
    if 3 * both.sum() < FEWEST:
        return False
    products = np.where(both, np.sum(field * field[:, :, near], axis=1), 0.0).sum(0)
    return bool(products.sum() > CHANCE * np.linalg.norm(products))


def discrepancy_of(observation: Observation, residual: Float[np.ndarray, " rows"]) -> Discrepancy | None:
    """The error of the model that a residual of markers shows; None where frames and markers are too few.

    residual  of each seen coordinate, in the order of the comparison of markers [m]
    """
    seen = observation.seen
    field = _field(residual, seen)
    count = 3.0 * seen.sum(1)
    of_frame = np.sqrt(np.square(field).sum((1, 2)) / np.maximum(count, 1.0))
    size = float(np.sqrt(np.mean(np.square(residual))))
    told = of_frame > SMALLEST_SHARE * size
    if told.sum() < 3 or 3 * seen[told].sum() < FEWEST:
        return None
    # in units of each frame; what is not seen, and the start, are zeros without weight
    unit = np.where(told[:, None, None], field / np.maximum(of_frame, 1e-300)[:, None, None], 0.0)
    weight = (seen & told[:, None]).astype(float)
    time, place = observation.time, observation.places
    apart, distance = np.abs(time[:, None] - time), cdist(place, place)
    reach_in_time = _reach(
        apart, *_correlations(unit.transpose(0, 2, 1).reshape(len(time), -1), np.repeat(weight, 3, 1))
    )
    by_marker = unit.transpose(2, 0, 1).reshape(len(place), -1)
    reach_in_space = _reach(distance, *_correlations(by_marker, np.repeat(weight.T, 3, 1)))
    correlation_in_time, correlation_in_space = np.exp(-apart / reach_in_time), np.exp(-distance / reach_in_space)
    frames = np.ix_(told, told)
    patterns = 3.0 * _independent(correlation_in_time[frames]) * _independent(correlation_in_space)
    return Discrepancy(
        size,
        reach_in_time,
        reach_in_space,
        patterns,
        of_frame=of_frame,
        seen=seen,
        in_time=correlation_in_time,
        in_space=correlation_in_space,
    )


def _field(rows: Float[np.ndarray, " rows"], seen: Bool[np.ndarray, "frames markers"]) -> np.ndarray:
    """Rows by frame, coordinate and marker, (frames, 3, markers), 0 where one was not seen."""
    field = np.zeros((len(seen), 3, seen.shape[1]))
    field[np.broadcast_to(seen[:, None, :], field.shape)] = rows
    return field


def _correlations(
    unit: Float[np.ndarray, "points values"], weight: Float[np.ndarray, "points values"]
) -> tuple[Float[np.ndarray, "points points"], Float[np.ndarray, "points points"]]:
    """Mean products of the values of two points, and how many values they have in common."""
    common = weight @ weight.T
    return (unit @ unit.T) / np.maximum(common, 1.0), common


def _reach(
    apart: Float[np.ndarray, "points points"],
    correlation: Float[np.ndarray, "points points"],
    common: Float[np.ndarray, "points points"],
) -> float:
    """The reach of exp(-apart / reach) that is nearest to the mean correlations of classes of pairs."""
    first, second = np.triu_indices(len(apart), 1)
    far, weight = apart[first, second], common[first, second]
    size = max(float(far.max(initial=0.0)), 1e-12)
    number = np.minimum((far / size * CLASSES).astype(int), CLASSES - 1)
    total = np.bincount(number, weight, CLASSES)
    used = total > 0.0
    mean, middle = (
        np.bincount(number, weight * values, CLASSES)[used] / total[used]
        for values in (correlation[first, second], far)
    )
    tried = size * np.geomspace(SHORTEST, LONGEST, TRIED)
    # short and long distances count alike: the far ones are few patterns, however many pairs they have
    misfit = [float(np.square(mean - np.exp(-middle / reach)).sum()) for reach in tried.tolist()]
    return float(tried[int(np.argmin(misfit))])


def _independent(correlation: Float[np.ndarray, "points points"]) -> float:
    """How many independent values have the variance of their mean square in common with so many correlated ones."""
    return float(np.trace(correlation) ** 2 / np.square(correlation).sum())
