"""Levenberg-Marquardt on the unknowns: Gauss-Newton steps, shortened until they help.

source  Marquardt 1963, "An algorithm for least-squares estimation of nonlinear parameters"; the damping follows Nielsen
        1999 in being divided after a success and multiplied after a failure
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from pcnclaws.estimation.problem import Linearisation

FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-2, 1e-9, 1e7
BETTER, WORSE = 0.1, 10.0
# Longest step in a coordinate: a sigmoid's unit is about a fifth of the interval between its bounds.
LONGEST_STEP = 1.5
# The search ends at a step below this, or where the error falls by less than this share of it.
SMALLEST_STEP, SMALLEST_GAIN = 1e-4, 1e-4


@dataclass
class LevenbergMarquardt:
    """The damping of the search, and whether it has ended."""

    damping: float = FIRST_DAMPING
    done: bool = False

    def step(self, at: Linearisation) -> Float[np.ndarray, " unknowns"]:
        """The next change of the coordinates. An unknown without influence stays."""
        normal, gradient = at.jacobian @ at.jacobian.T, at.jacobian @ at.residual
        scale = np.diag(normal).copy()
        felt = scale > 0.0
        change = np.zeros(len(scale))
        if felt.any():
            damped = normal + self.damping * np.diag(scale)
            change[felt] = -np.linalg.solve(damped[np.ix_(felt, felt)], gradient[felt])
        return change * min(1.0, LONGEST_STEP / max(float(np.abs(change).max()), 1e-300))

    def judge(self, before: float, after: float, step: Float[np.ndarray, " unknowns"]) -> bool:
        """Whether the step is taken: before and after are errors [m^2]."""
        small = float(np.abs(step).max()) < SMALLEST_STEP
        if after < before:
            self.damping = max(self.damping * BETTER, LEAST_DAMPING)
            self.done = small or 1.0 - after / before < SMALLEST_GAIN
            return True
        self.damping *= WORSE
        self.done = small or self.damping > MOST_DAMPING
        return False
