"""Posterior of the unknowns by samples: an ensemble of walkers in coordinates, each step a batch of simulations.

The likelihood is exp(-S / (2 variance)) of the sum S of the squared residual, with the variance of error that makes the
intervals of the linear problem; of several such, the largest. The prior is flat in each number within its bounds, in
the logarithm of moduli and yield stress.
source  Goodman and Weare 2010, "Ensemble samplers with affine invariance"; Foreman-Mackey et al. 2013, "emcee: The MCMC
        Hammer"
"""

import importlib
import logging
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from pcnclaws.atomic import replaced_file
from pcnclaws.data.guarded_npz import opened_arrays
from pcnclaws.errors import UserError, not_installed
from pcnclaws.estimation.problem import EstimationProblem
from pcnclaws.estimation.uncertainty import Uncertainty

log = logging.getLogger(__name__)

# Walkers an unknown, and fewest; steps of all of them between two looks at the disk.
WALKERS, FEWEST_WALKERS, STEPS_AT_ONCE = 4, 8, 5
# Walkers start as the linear problem spreads them, but within so much of a coordinate, and forget that in this share of
# the steps. One that starts where nothing can be simulated is put nearer to the estimate, so many times.
FARTHEST_START, BURNED, NEARER = 0.3, 0.25, 10
IMPOSSIBLE = -1e12
QUANTILES = (0.025, 0.5, 0.975)


@dataclass(frozen=True)
class Posterior:
    """Samples of the unknowns that the motion depends on.

    labels      of them
    values      of each sample, (samples, unknowns)
    effective   how many independent samples they are worth
    acceptance  share of the proposals that were taken [-]
    """

    labels: tuple[str, ...]
    values: Float[np.ndarray, "samples unknowns"]
    effective: float
    acceptance: float

    def interval(self, label: str) -> tuple[float, float] | None:
        """The central 95 % of the samples; None for an unknown without influence."""
        if label not in self.labels:
            return None
        low, _, high = np.quantile(self.values[:, self.labels.index(label)], QUANTILES).tolist()
        return low, high


def sampled(
    problem: EstimationProblem,
    u: Float[np.ndarray, " unknowns"],
    found: Uncertainty,
    *,
    simulations: int,
    seed: int,
    kept: Path,
    progress: Callable[[int], None] | None = None,
) -> Posterior:
    """Samples around the coordinates u of an estimate.

    simulations  how many are made, about
    kept         an .npz where walkers are kept; sampling that was interrupted goes on from there
    progress     called with the number of simulations just made
    """
    emcee = require_emcee()
    told = np.flatnonzero(np.isfinite(found.error_variance))
    if not len(told):
        return Posterior((), np.zeros((0, 0)), 0.0, 0.0)
    density = _Density(problem, u, told, float(found.error_variance[told].max()), progress)
    walkers = max(WALKERS * len(told), FEWEST_WALKERS)
    steps = max(round(simulations / walkers), 2 * STEPS_AT_ONCE)
    sampler = emcee.EnsembleSampler(walkers, len(told), density, vectorize=True)
    chain, state = _kept(kept, walkers, len(told))
    if state is None:
        random = np.random.RandomState(seed)
        start, heights = _start(density, found, walkers, random)
        state = emcee.State(start, log_prob=heights, random_state=random.get_state())
    elif progress:
        progress(len(chain) * walkers)
    while len(chain) < steps:
        moves = sampler.sample(state, iterations=min(STEPS_AT_ONCE, steps - len(chain)), store=False)
        for state in moves:
            if density.fault is not None:
                raise density.fault
            chain = np.concatenate((chain, state.coords[None]))
        _keep(kept, chain, state)
    chain = chain[round(BURNED * steps) :]
    sought = [problem.unknowns.sought[k] for k in told]
    values = [one.transform.value(chain[:, :, k].ravel()) for k, one in enumerate(sought)]
    time = emcee.autocorr.integrated_time(chain, quiet=True, tol=0)
    moved = np.any(np.diff(chain, axis=0) != 0.0, axis=-1)
    return Posterior(
        tuple(one.label for one in sought),
        np.stack(values, axis=1),
        effective=float(chain.shape[0] * walkers / max(np.max(time), 1.0)),
        acceptance=float(np.mean(moved)),
    )


class _Density:
    """The logarithm of the posterior density of candidates, (candidates, told), up to a constant."""

    def __init__(
        self,
        problem: EstimationProblem,
        u: np.ndarray,
        told: np.ndarray,
        variance: float,
        progress: Callable[[int], None] | None,
    ) -> None:
        self.problem, self.u, self.told, self.variance, self.progress = problem, u, told, variance, progress
        self.fault: BaseException | None = None

    def __call__(self, candidates: Float[np.ndarray, "candidates told"]) -> Float[np.ndarray, " candidates"]:
        """For emcee, which would print the traceback of an interruption: it is kept in `fault`."""
        if self.fault is None:
            try:
                return self.heights(candidates)
            except BaseException as fault:
                self.fault = fault
        return np.full(len(candidates), IMPOSSIBLE)

    def heights(self, candidates: Float[np.ndarray, "candidates told"]) -> Float[np.ndarray, " candidates"]:
        """The logarithm of the density."""
        whole = np.tile(self.u, (len(candidates), 1))
        whole[:, self.told] = candidates
        squares = self.problem.comparison.rows * np.array(self.problem.mse(list(whole)))
        prior = [self.problem.unknowns.sought[k].transform.log_density(whole[:, k]) for k in self.told]
        if self.progress:
            self.progress(len(candidates))
        # a number where a candidate is impossible: walkers that begin there have to get away
        return np.maximum(np.sum(prior, axis=0) - 0.5 * squares / self.variance, IMPOSSIBLE)


def _start(
    density: _Density, found: Uncertainty, walkers: int, random: np.random.RandomState
) -> tuple[Float[np.ndarray, "walkers told"], Float[np.ndarray, " walkers"]]:
    """Where walkers start around the estimate, and the logarithm of the density there."""
    told = density.told
    deviation = np.sqrt(np.diag(found.covariance)[told])
    spread = deviation * min(1.0, FARTHEST_START / float(deviation.max()))  # along the valley, where there is one
    correlation = found.correlation[np.ix_(told, told)]
    away = spread * random.multivariate_normal(np.zeros(len(told)), correlation, walkers, check_valid="ignore")
    heights = density.heights(density.u[told] + away)
    for _ in range(NEARER):
        lost = heights <= IMPOSSIBLE
        if not lost.any():
            break
        away[lost] *= 0.5
        heights[lost] = density.heights(density.u[told] + away[lost])
    return density.u[told] + away, heights


def _keep(path: Path, chain: np.ndarray, state: Any) -> None:
    _, keys, place, has_gauss, gauss = state.random_state
    with replaced_file(path) as part:
        np.savez(
            part,
            chain=chain,
            coordinates=state.coords,
            log_density=state.log_prob,
            keys=keys,
            random=np.array([place, has_gauss, gauss], dtype=np.float64),
        )


def _kept(path: Path, walkers: int, told: int) -> tuple[np.ndarray, Any | None]:
    """The steps of walkers so far, (steps, walkers, told), and where they are; none where nothing is kept."""
    nothing = np.zeros((0, walkers, told)), None
    if not path.is_file():
        return nothing
    try:
        with opened_arrays(path) as arrays:
            chain, coordinates, density = (np.asarray(arrays[name]) for name in ("chain", "coordinates", "log_density"))
            keys, (place, has_gauss, gauss) = np.asarray(arrays["keys"]), np.asarray(arrays["random"]).tolist()
    except (UserError, KeyError, ValueError) as fault:
        log.warning("%s: the samples begin anew", fault)
        return nothing
    if chain.shape[1:] != (walkers, told) or coordinates.shape != (walkers, told):
        return nothing
    random = ("MT19937", keys, int(place), int(has_gauss), gauss)
    return chain, require_emcee().State(coordinates, log_prob=density, random_state=random)


def require_emcee() -> Any:
    """The package that moves the walkers; UserError where it is not installed."""
    try:
        return importlib.import_module("emcee")
    except ImportError as fault:
        raise not_installed("uncertainty=sample", "emcee", "sample", "uncertainty=profile") from fault
