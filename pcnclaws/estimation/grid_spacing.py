"""The grid spacing that a motion is most like, as one more unknown of an estimate, and what it leaves in doubt.

Two grids tell how the best numbers u and their residual r change with the spacing. Numbers and spacing together have a
minimum near the line through the two. Only the finer grid is simulated: each step to the minimum is, at the spacing of
that grid, and corrects the Jacobian (Broyden). What is left in doubt: three grids tell how much u(h) is bent, and the
derivatives of the coarser grid lead to other numbers than the differences of the finer one do.

A few markers, such as those of the corner that hits a wall, may be missed by many times what the others are: contact
differs most from grid to grid. Their errors are taken for larger ones, and they count less. Errors of one size for all
markers, with that of the first frame, hardly reach where this begins.
"""

import numpy as np

from pcnclaws.estimation.levenberg_marquardt import LevenbergMarquardt
from pcnclaws.estimation.problem import Linearisation
from pcnclaws.estimation.refinement import Stage, corrected
from pcnclaws.estimation.unknowns import GRID_SPACING

# Fine simulations that check steps, at most. No more where the step left is a part of a standard deviation: the sum of
# squares over the noise is to fall by less than this.
CHECKS, LEAST_CHI_SQUARE, FIRST_DAMPING = 6, 0.5, 1e-6
# Weights and residual are found in turn, so many times. All markers count alike up to so many times the typical error.
WEIGHINGS, TYPICAL = 5, 2.0


def most_alike(coarsest: Stage, coarse: Stage, fine: Stage) -> Stage:
    """The estimate at the grid spacing that the motion is most like, from the estimates on three grids.

    The finest grid is simulated at a few other numbers.
    """
    derivatives = fine.at.jacobian
    search, here = LevenbergMarquardt(FIRST_DAMPING), along_spacing(coarse, fine)
    for _ in range(WEIGHINGS):
        here = along_spacing(coarse, fine, weights_of_parts(here.at))
    for _ in range(CHECKS):
        step = _joint_step(search, here)
        if _chi_square(here.weighted, step) < LEAST_CHI_SQUARE:
            break
        step[fine.problem.unknowns.index(GRID_SPACING)] = 0.0
        residual = fine.problem.residual(fine.u + step)
        if not np.isfinite(residual).all():
            search.judge(here.weighted.mse, np.inf, step)
            continue
        jacobian = corrected(fine.at.jacobian, step, residual - fine.at.residual)
        fine = fine._replace(at=fine.at._replace(jacobian=jacobian))
        tried = fine._replace(u=fine.u + step, at=fine.at._replace(residual=residual))
        if search.judge(here.weighted.mse, along_spacing(coarse, tried, here.weight).weighted.mse, step):
            fine = tried
        here = along_spacing(coarse, fine, here.weight)
        here = along_spacing(coarse, fine, weights_of_parts(here.at))
    bent = curvature(coarsest, coarse, fine, here.u)
    return here._replace(doubt=np.stack([bent, _by_derivatives(coarse, fine, derivatives, here) - here.u]))


def along_spacing(coarse: Stage, fine: Stage, weight: np.ndarray | None = None) -> Stage:
    """The estimate at the grid spacing that the motion is most like, on the line through two estimates.

    The spacing is an unknown like the others from here on: its row of the Jacobian is the change of the residual along
    the line, and the other numbers are correlated with it. It does not fall below 0.
    weight  how much each row counts, (rows,) [-]
    """
    (index,) = fine.problem.unknowns.index(GRID_SPACING)
    ends = [_with_spacing(stage) for stage in (coarse, fine)]
    along = ends[0] - ends[1]
    change = coarse.at.residual - fine.at.residual
    by_row = np.ones(len(change)) if weight is None else weight
    # what the other unknowns do not take up; u follows the line by itself
    others, alone = by_row * np.delete(fine.at.jacobian, index, axis=0), by_row * change
    alone = alone - others.T @ np.linalg.lstsq(others.T, alone, rcond=1e-9)[0]
    square = float(alone @ alone)
    share = -float(alone @ (by_row * fine.at.residual)) / square if square > 0.0 else 0.0
    share = max(share, -ends[1][index] / along[index])
    u, residual = ends[1] + share * along, fine.at.residual + share * change
    jacobian = fine.at.jacobian.copy()
    # d r / d h at fixed other numbers: along the line these change, too
    fixed = along.copy()
    fixed[index] = 0.0
    jacobian[index] = (change - fixed @ jacobian) / along[index]
    return Stage(fine.problem, u, fine.at._replace(residual=residual, jacobian=jacobian), weight=weight)


def weights_of_parts(at: Linearisation) -> np.ndarray:
    """Weights of rows (rows,) [-]: 1, and less for the rows of a marker that is missed by much more than others are.

    w = min(1, 2 sqrt(median(m) / m)),   m the mean squared residual of the marker
    """
    count = np.maximum(np.bincount(at.part), 1)
    square = np.bincount(at.part, np.square(at.residual)) / count
    seen = square[square > 0.0]
    typical = float(np.median(seen)) if len(seen) else 1.0
    return np.minimum(1.0, TYPICAL * np.sqrt(typical / np.maximum(square, 1e-300)))[at.part]


def curvature(coarsest: Stage, coarse: Stage, fine: Stage, u: np.ndarray) -> np.ndarray:
    """What a parabola through the coordinates on three grids differs by from the line through the finer two.

    u        coordinates, the spacing among them, where it is asked for, (unknowns,)
    returns  difference, 0 for the spacing, (unknowns,)
    """
    first, second, third = (_with_spacing(stage) for stage in (coarsest, coarse, fine))
    (index,) = fine.problem.unknowns.index(GRID_SPACING)

    def weight(at: float) -> float:
        return (at - second[index]) * (at - third[index])

    slope = (second - third) / (second[index] - third[index])
    bend = first - second - slope * (first[index] - second[index])
    return bend * weight(u[index]) / weight(first[index])


def _by_derivatives(coarse: Stage, fine: Stage, derivatives: np.ndarray, found: Stage) -> np.ndarray:
    """The coordinates where the derivatives of the coarser grid would lead, not corrected by fine simulations."""
    line = along_spacing(coarse, fine._replace(at=fine.at._replace(jacobian=derivatives)), found.weight)
    return line.u + _joint_step(LevenbergMarquardt(FIRST_DAMPING), line)


def _joint_step(search: LevenbergMarquardt, here: Stage) -> np.ndarray:
    """The next change of the coordinates (unknowns,) with that of the spacing, which does not fall below 0.

    A step that reaches too far is shortened as a whole: what is left of it still leads downwards.
    """
    (index,) = here.problem.unknowns.index(GRID_SPACING)
    reach, at = here.problem.unknowns.reach(here.u), here.weighted
    anywhere = np.full_like(reach, np.inf) * [[-1.0], [1.0]]
    step = search.step(at, anywhere)
    if here.u[index] + step[index] < 0.0:
        jacobian = at.jacobian.copy()
        jacobian[index] = 0.0  # what has no influence stays
        step = search.step(at._replace(jacobian=jacobian), anywhere)
    longest = np.where(step < 0.0, reach[0], reach[1])
    shares = np.divide(longest, step, out=np.ones_like(step), where=step != 0.0)
    return step * min(1.0, float(shares.min()))


def _chi_square(at: Linearisation, step: np.ndarray) -> float:
    """By how much a step is to make the sum of squares smaller, in units of the mean square [-]."""
    ahead = at.residual + step @ at.jacobian
    return float((at.residual @ at.residual - ahead @ ahead) / at.mse)


def _with_spacing(stage: Stage) -> np.ndarray:
    """The coordinates of an estimate, that of the spacing of its own grid among them."""
    u, unknowns = stage.u.copy(), stage.problem.unknowns
    (index,) = unknowns.index(GRID_SPACING)
    u[index] = unknowns.sought[index].transform.coordinate(stage.problem.observation.settings.grid_spacing)
    return u
