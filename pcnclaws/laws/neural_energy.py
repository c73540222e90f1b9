"""Neural elasticity with a stored energy, `model=pcnclaws_energy`: the work of a closed strain cycle is zero.

The energy is a sum over the principal Hencky strains, over their deviators, and of the volume, as in Valanis and Landel
1967 ("The strain-energy function of a hyperelastic material in terms of the extension ratios") and Ogden 1972 ("Large
deformation isotropic elasticity"). Its functions of one strain are Hencky's, whose moduli are E and nu, and something
more of higher order, whose amounts are polynomials of the physical parameters: once a rollout, not once a step. The
stress is linear in these weights, so that Gauss-Newton finds them (training/gauss_newton.py).
"""

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, ClassVar

import numpy as np
import torch
from torch import Tensor

from pcnclaws.laws import principal
from pcnclaws.laws.base import Elasticity, Values
from pcnclaws.laws.materials import Material
from pcnclaws.laws.moduli import lame_constants
from pcnclaws.laws.networks import ConditionedAmounts, DimensionlessParameters
from pcnclaws.laws.operations import deviator, exp, maximum, minimum, trace
from pcnclaws.tensors.tensor_types import Matrices, Parameters

# Strains between which the functions are made orthogonal to each other, so that none is huge anywhere: soft bodies that
# meet a floor are crushed to a tenth of their volume, and stretched by a fifth. Limits of what a law sees are within.
LARGEST_STRAINS = (-2.4, 0.8)
# Least and largest second derivative of the energy by a strain between the limits, in units of that at rest: fixed
# corotated elasticity goes from -0.1 to 12 between strains of -1 and 1. Beyond them the least one is positive.
CURVATURES, LEAST_TANGENT = (-0.3, 30.0), 0.05
# Limits of a law that has seen no deformation, and the least that what it sees can make of them.
UNSEEN_LIMITS, LEAST_LIMIT = (-0.6, 0.6), 0.05
# So many particles hold one that may be beyond the limits.
ONE_IN = 2000
ENDS = ("low", "high")
# What the functions are of: each principal strain, each of its deviators, and the volume.
TERMS = ("strain", "deviator", "volume")


class EnergyNet(Elasticity):
    """Isotropic elasticity that is the derivative of an energy, zero and free of stress at rest.

        psi = 2 mu sum_i (w(h_i) + d(dev h_i)) + lambda v(tr h)
        w(h) = h^2/2 + sum_k g_k f_k(h)

    and so v; d without the square. The f_k are combinations of (e^(a h) - 1 - a h)/a^2 - h^2/2 with the exponents a:
    their second derivative is 0 at rest, so that E and nu are the moduli of small strain, and neo-Hookean, fixed
    corotated and Ogden's laws with these exponents are among the sums. The g_k depend on nu, and on further parameters.
    Beyond the limits of the strains that it has seen, the energy of each goes on as a parabola, without bound: where
    det F nears 0 it becomes infinite. Between them its curvature has bounds, so that no choice of weights makes a body
    that is stiffer than its time step allows or that falls to an energy far below rest. Untrained it is the Hencky law.

    limits  of the strains of each term, (terms, 2)
    """

    exponents: ClassVar[tuple[float, ...]] = (1.0, 2.0, -1.0, -2.0, 4.0)
    limits: Tensor

    def __init__(self, material: Material, width: int) -> None:
        super().__init__()
        self.is_bounded = True  # False where the stress must be linear in the weights
        self.parameter_names = material.elasticity.parameter_names
        condition = DimensionlessParameters(material.ranges, self.parameter_names)
        self.amounts = ConditionedAmounts(condition, len(TERMS) * len(self.exponents))
        self.register_buffer("limits", torch.tensor(UNSEEN_LIMITS).repeat(len(TERMS), 1))

    def see(self, deformation: Matrices, beside: bool = False) -> None:
        strain = principal.strains(deformation)
        volume = strain.sum(0)
        of_terms = (strain.flatten(), (strain - volume / 3.0).flatten(), volume)
        ends = [torch.stack((-_reached(-one), _reached(one))) for one in of_terms]
        limits = torch.stack(ends).clamp(*LARGEST_STRAINS)
        if beside:
            low, high = torch.minimum(limits, self.limits)[:, 0], torch.maximum(limits, self.limits)[:, 1]
            limits = torch.stack((low, high), 1)
        self.limits.copy_(limits)

    def coefficients(self, parameters: Parameters) -> Mapping[str, Tensor]:
        lam, mu = lame_constants(parameters)
        amounts = self.amounts(parameters).to(mu.dtype)
        change = self._curvature_changes(amounts)
        if self.is_bounded:
            share = _share_within_bounds(change)[:, None]
            amounts, change = amounts * share.repeat_interleave(len(self.exponents), 0)[:, 0], change * share
        found, at_ends = {"mu": mu, "lam": lam}, torch.stack((change[:, 0], change[:, -1]), 1)
        for term, of_term, ends, limits in zip(
            TERMS, amounts.unflatten(0, (len(TERMS), -1)), at_ends, self.limits.to(mu), strict=True
        ):
            found |= {f"{term}_{k}": amount for k, amount in enumerate(of_term)}
            # of the deviators, which add to the strains, the least that softens nothing
            least, most = (0.0 if term == "deviator" else LEAST_TANGENT - 1.0), CURVATURES[1] - 1.0
            found |= {f"{term}_{end}_tangent": ends[k].clamp(least, most) for k, end in enumerate(ENDS)}
            found |= {f"{term}_{end}": limits[k].expand_as(mu) for k, end in enumerate(ENDS)}
        return found

    def _curvature_changes(self, amounts: Tensor) -> Tensor:
        """What the functions of each term add to its second derivative, from limit to limit, (terms, strains, ...)."""
        rows = _curvatures(self.exponents, self.limits.double()).to(amounts)
        return torch.einsum("tgk,tkn->tgn", rows, amounts.unflatten(0, (len(TERMS), -1)))

    def principal_stress(self, h: Values, p: Any) -> Values:
        of_deviators = [self._slope(one, p, "deviator") for one in deviator(h)]
        mean, volumetric, two_mu = trace(of_deviators) / 3.0, trace(h), 2.0 * p.mu
        pressure = p.lam * (volumetric + self._slope(volumetric, p, "volume")) - two_mu * mean
        return [
            two_mu * (strain + self._slope(strain, p, "strain") + of_deviator) + pressure
            for strain, of_deviator in zip(h, of_deviators, strict=True)
        ]

    def principal_energy(self, h: Values, p: Any) -> Any:
        volumetric = trace(h)
        of_strains = sum(0.5 * strain * strain + self._energy(strain, p, "strain") for strain in h)
        of_deviators = sum(self._energy(one, p, "deviator") for one in deviator(h))
        of_volume = 0.5 * volumetric * volumetric + self._energy(volumetric, p, "volume")
        return 2.0 * p.mu * (of_strains + of_deviators) + p.lam * of_volume

    def _slope(self, x: Any, p: Any, term: str) -> Any:
        """sum_k g_k f_k'(x), beyond the limits on along its tangent."""
        within, below, above = self._parts(x, p, term)
        return self._sum(_slopes(within, self.exponents), p, term) + (
            below * getattr(p, f"{term}_low_tangent") + above * getattr(p, f"{term}_high_tangent")
        )

    def _energy(self, x: Any, p: Any, term: str) -> Any:
        """sum_k g_k f_k(x), beyond the limits a parabola."""
        within, below, above = self._parts(x, p, term)
        at_limit = self._sum(_slopes(within, self.exponents), p, term)
        parabola = below * below * getattr(p, f"{term}_low_tangent") + above * above * getattr(
            p, f"{term}_high_tangent"
        )
        return self._sum(_energies(within, self.exponents), p, term) + (below + above) * at_limit + 0.5 * parabola

    def _parts(self, x: Any, p: Any, term: str) -> tuple[Any, Any, Any]:
        """What of a strain is within the limits, and how far it is below and above them."""
        low, high = getattr(p, f"{term}_low"), getattr(p, f"{term}_high")
        within = minimum(maximum(x, low), high)
        nothing = 0.0 * x
        return within, minimum(x - low, nothing), maximum(x - high, nothing)

    def _sum(self, functions: Sequence[Any], p: Any, term: str) -> Any:
        """Each of the orthogonal functions times its amount: in this order, since their coefficients cancel."""
        return sum(
            getattr(p, f"{term}_{k}") * sum(float(share) * one for share, one in zip(row, functions, strict=True))
            for k, row in enumerate(_shares(self.exponents))
        )


def _slopes(x: Any, exponents: Sequence[float]) -> list[Any]:
    """(e^(a x) - 1)/a - x of each exponent a."""
    return [(exp(a * x) - 1.0) / a - x for a in exponents]


def _energies(x: Any, exponents: Sequence[float]) -> list[Any]:
    """Integrals of `_slopes` from 0."""
    return [(exp(a * x) - 1.0 - a * x) / a**2 - 0.5 * x * x for a in exponents]


def _reached(values: Tensor) -> Tensor:
    """The largest value but for a share of ONE_IN, at least LEAST_LIMIT."""
    count = max(1, values.numel() // ONE_IN)
    return values.topk(count).values[-1].clamp(min=LEAST_LIMIT)


def _share_within_bounds(change: Tensor) -> Tensor:
    """The factors, (terms, ...), that leave the curvatures of the energy in their bounds, (terms, strains, ...)."""
    low, high = change.amin(1).clamp(max=-1e-30), change.amax(1).clamp(min=1e-30)
    fall, rise = (torch.stack((end[0] + end[1], end[0] + end[1], end[2])) for end in (low, high))
    least, most = CURVATURES
    return torch.minimum((least - 1.0) / fall, (most - 1.0) / rise).clamp(max=1.0)


def _curvatures(exponents: tuple[float, ...], limits: Tensor) -> Tensor:
    """Second derivatives of the orthogonal functions from limit to limit, (terms, strains, functions)."""
    share = torch.linspace(0.0, 1.0, 17, dtype=limits.dtype, device=limits.device)
    x = limits[:, :1] + share * (limits[:, 1:] - limits[:, :1])
    of_each = torch.stack([torch.exp(a * x) - 1.0 for a in exponents], -1)
    return of_each @ torch.from_numpy(_shares(exponents)).to(x).T


@cache
def _shares(exponents: tuple[float, ...]) -> np.ndarray:
    """Combinations, as rows, whose slopes are orthogonal between the largest strains, each as large as x there."""
    nodes, weights = np.polynomial.legendre.leggauss(64)
    low, high = LARGEST_STRAINS
    x = torch.from_numpy(0.5 * (low + high) + 0.5 * (high - low) * nodes)
    values = torch.stack(_slopes(x, exponents)).numpy()
    size = np.sqrt((high**3 - low**3) / (3.0 * (high - low)))
    # sqrt(w/2) values^T = Q R: the rows of R^-T values are orthonormal
    _, upper = np.linalg.qr(np.sqrt(0.5 * weights)[:, None] * values.T)
    return size * np.linalg.inv(upper).T
