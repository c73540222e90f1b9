"""Estimates on finer grids, from the derivatives of coarser ones, and the grid spacing that a motion is most like.

A fine simulation is expensive, and its derivatives many times as much. The residual of the fine grid alone says where
the minimum is; which way to go is told well enough by the Jacobian of a coarser grid, which is corrected by each fine
simulation in the direction of the step (Broyden). A few fine simulations without derivatives are enough.
source  Broyden 1965, "A class of methods for solving nonlinear simultaneous equations"; Bandler et al. 1995,
        "Electromagnetic optimization exploiting aggressive space mapping"

What a grid does wrong (contact begins early and is soft, motion is damped) grows with its spacing h. Two grids tell how
the best numbers u and their residual r change with h; where the residual is smallest along this line is the spacing
that the motion is most like: none for a continuum, that of its own grid for a simulation (estimation/grid_spacing.py).
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from pcnclaws.estimation.levenberg_marquardt import LevenbergMarquardt
from pcnclaws.estimation.problem import EstimationProblem, Linearisation

# Fine simulations on one grid, at most; no more where the mean squared residual falls by less than this share.
SIMULATIONS, LEAST_GAIN = 8, 2e-3
# The coarser Jacobian is near, the start is not far.
FIRST_DAMPING = 1e-3


class Stage(NamedTuple):
    """An estimate on one grid.

    problem  with the settings of that grid
    u        coordinates, (unknowns,)
    at       the residual of that grid, and the Jacobian of it or of a coarser one
    settled  whether the search came to its end
    doubt    errors of all coordinates in common, one standard deviation of each, (errors, unknowns); None for none
    weight   how much each row counts, (rows,) [-]; None: all alike
    """

    problem: EstimationProblem
    u: np.ndarray
    at: Linearisation
    settled: bool = True
    doubt: np.ndarray | None = None
    weight: np.ndarray | None = None

    @property
    def weighted(self) -> Linearisation:
        """The residual and its Jacobian, times the weights."""
        if self.weight is None:
            return self.at
        return self.at._replace(residual=self.weight * self.at.residual, jacobian=self.weight * self.at.jacobian)


def refined(coarse: Stage, problems: Sequence[EstimationProblem]) -> Iterator[Stage]:
    """Estimates on finer and finer grids, as they are made.

    problems  the same observation and unknowns on each of them, finer ones last; derivatives of the last are not taken
    """
    last = coarse
    for number, problem in enumerate(problems):
        before, last = last, followed(last, problem)
        if number < len(problems) - 1:
            last = followed(last._replace(at=problem.linearise(last.u)), problem)
        elif not last.settled:
            last = _by_new_derivatives(before, last)
        yield last


def _by_new_derivatives(before: Stage, last: Stage) -> Stage:
    """The search on the finest grid gone on with, by derivatives of the grid before at the numbers that it has reached.

    What stands around the body, and its size, are those of that grid: the body is to meet its walls in the same frames.
    """
    u, around = last.u.copy(), last.problem.unknowns.surroundings
    u[around] = before.u[around]
    at = before.problem.linearise(u)
    if not np.isfinite(at.mse):
        return last
    return followed(last._replace(at=last.at._replace(jacobian=at.jacobian)), last.problem)


def followed(start: Stage, problem: EstimationProblem) -> Stage:
    """The estimate on another grid, by the Jacobian of the start."""
    u, jacobian, part = start.u, start.at.jacobian.copy(), start.at.part
    same = problem is start.problem
    here = start.at if same else Linearisation(problem.residual(u), jacobian, part)
    search, settled = LevenbergMarquardt(FIRST_DAMPING), False
    for _ in range(SIMULATIONS):
        step = search.step(here, problem.unknowns.reach(u))
        there = Linearisation(problem.residual(u + step), jacobian, part)
        before, after = here.mse, there.mse
        taken = search.judge(before, after, step)
        if np.isfinite(after):
            jacobian = corrected(jacobian, step, there.residual - here.residual)
        if taken:
            u, here = u + step, there
        here = here._replace(jacobian=jacobian)
        settled = search.done or (taken and 1.0 - after / before < LEAST_GAIN)
        if settled:
            break
    # intervals are those of exact derivatives, of the finest grid that has them
    return Stage(problem, u, here._replace(jacobian=start.at.jacobian), settled)


def corrected(jacobian: np.ndarray, step: np.ndarray, change: np.ndarray) -> np.ndarray:
    """The nearest Jacobian (unknowns, rows) that explains the change of the residual (rows,) by a step (unknowns,)."""
    return jacobian + np.outer(step, change - step @ jacobian) / max(float(step @ step), 1e-300)
