"""Multi-start: many starts tried at once, of which the best, or the user's guess, is where the search begins."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.stats import qmc

from pcnclaws.estimation.problem import EstimationProblem
from pcnclaws.estimation.unknowns import Unknowns
from pcnclaws.laws.parameters import PARAMETERS

# The starts lie within this factor of the guess, or in the screening interval of the parameter.
FACTOR = 30.0
# A stiffness that is unstable with the observation's time step is lowered to this share of the limit.
STABLE_SHARE = 0.6


def screened_start(
    problem: EstimationProblem, guess: Float[np.ndarray, " unknowns"], count: int, seed: int = 0
) -> tuple[Float[np.ndarray, " unknowns"], Sequence[float]]:
    """The best of the guess and `count` other starts, and the mean squared errors [m^2] of all, the guess's first.

    Start velocities and the clock keep the guess's values.
    """
    starts = [guess, *_drawn(problem, guess, count, seed)]
    errors = problem.mse(starts)
    return starts[int(np.argmin(errors))], errors


def stable_start(problem: EstimationProblem, u: Float[np.ndarray, " unknowns"]) -> Float[np.ndarray, " unknowns"]:
    """The coordinates, softened where their stiffness is unstable with the observation's time step."""
    u, moduli = u.copy(), problem.unknowns.index("youngs_modulus")
    excess = problem.instability(u)
    while excess > 1.0 and moduli:
        values = problem.unknowns.values(u)
        values[moduli] *= STABLE_SHARE / excess**2  # the wave speed grows with the root of the modulus
        u = problem.unknowns.coordinates(values.tolist())
        excess = problem.instability(u)
    return u


def _drawn(problem: EstimationProblem, guess: np.ndarray, count: int, seed: int) -> list[np.ndarray]:
    unknowns = problem.unknowns
    sample = qmc.Halton(len(unknowns.physical), rng=np.random.default_rng(seed)).random(count)
    starts = []
    for point in sample:
        u = guess.copy()
        for k, share in zip(unknowns.physical, point.tolist(), strict=True):
            u[k] = _between(unknowns, k, guess, share)
        starts.append(stable_start(problem, u))
    return starts


def _between(unknowns: Unknowns, k: int, guess: np.ndarray, share: float) -> float:
    """The coordinate of a number within the span of the screening."""
    transform, name = unknowns.sought[k].transform, unknowns.sought[k].name
    parameter = PARAMETERS[name]
    if parameter.screening is not None:
        low, high = parameter.screening
        return transform.coordinate(low + share * (high - low))
    value, (lower, upper) = float(unknowns.values(guess)[k]), parameter.searched
    if not parameter.logarithmic:
        return transform.coordinate(lower + share * (upper - lower))
    low, high = max(value / FACTOR, 2.0 * lower), min(value * FACTOR, 0.5 * upper)
    return transform.coordinate(low * (high / low) ** share)
