"""Neural elasticity with a stored energy, `model=pcnclaws_energy`: the work of a closed strain cycle is zero.

The energy is a sum over the principal Hencky strains, over their deviators, and of the volume, as in Valanis and Landel
1967 ("The strain-energy function of a hyperelastic material in terms of the extension ratios") and Ogden 1972 ("Large
deformation isotropic elasticity"). Its functions of one strain are Hencky's, whose moduli are E and nu, and something
more of higher order, whose amounts a network gives from the physical parameters: once a rollout, not once a step.
"""

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, ClassVar

import numpy as np
import torch
from torch import Tensor

from pcnclaws.laws.base import Elasticity, Values
from pcnclaws.laws.materials import Material
from pcnclaws.laws.moduli import lame_constants
from pcnclaws.laws.networks import ConditionalMLP, DimensionlessParameters
from pcnclaws.laws.operations import deviator, exp, maximum, minimum, trace
from pcnclaws.tensor_types import Parameters

# Strains up to which the functions are made orthogonal to each other: those of soft bodies that meet a floor.
TYPICAL_STRAIN = 0.5
# What the functions are of: each principal strain, each of its deviators, and the volume.
TERMS = ("strain", "deviator", "volume")


class EnergyNet(Elasticity):
    """Isotropic elasticity that is the derivative of an energy, zero and free of stress at rest.

        psi = 2 mu sum_i (w(h_i) + d(dev h_i)) + lambda v(tr h)
        w(h) = h^2/2 + sum_k g_k f_k(h)

    and so v; d without the square. The f_k are combinations of (e^(a h) - 1 - a h)/a^2 - h^2/2 with the exponents a:
    their second derivative is 0 at rest, so that E and nu are the moduli of small strain, and neo-Hookean, fixed
    corotated and Ogden's laws with these exponents are among the sums. The g_k depend on nu, and on further parameters,
    through a network. Beyond `limit` the energy goes on as Hencky's does, without bound: where det F nears 0 it becomes
    infinite. An untrained network is the Hencky law.
    """

    exponents: ClassVar[tuple[float, ...]] = (1.0, 2.0, -1.0, -2.0, 4.0)
    limit: ClassVar[float] = 1.5

    def __init__(self, material: Material, width: int) -> None:
        super().__init__()
        self.parameter_names = material.elasticity.parameter_names
        self.condition = DimensionlessParameters(material.ranges, self.parameter_names)
        # one input more than there are parameters to depend on, as there may be none
        self.amounts = ConditionalMLP(1 + self.condition.count, len(TERMS) * len(self.exponents), width)

    def coefficients(self, parameters: Parameters) -> Mapping[str, Tensor]:
        lam, mu = lame_constants(parameters)
        known = self.condition(parameters) if self.condition.count else mu[None][:0]
        given = torch.cat((torch.ones_like(mu)[None], known))
        precision = self.amounts.weights[0].dtype
        amounts = self.amounts(given.to(precision)).to(mu.dtype)
        names = [f"{term}_{k}" for term in TERMS for k in range(len(self.exponents))]
        return {"mu": mu, "lam": lam, **dict(zip(names, amounts.unbind(0), strict=True))}

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
        """sum_k g_k f_k'(x), constant beyond `limit`."""
        return self._sum(_slopes(self._within(x), self.exponents), p, term)

    def _energy(self, x: Any, p: Any, term: str) -> Any:
        """sum_k g_k f_k(x), linear beyond `limit`."""
        within = self._within(x)
        beyond = (x - within) * self._slope(x, p, term)
        return self._sum(_energies(within, self.exponents), p, term) + beyond

    def _within(self, x: Any) -> Any:
        limit = self.limit if not isinstance(x, Tensor) else torch.full_like(x, self.limit)
        return minimum(maximum(x, -limit), limit)

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


@cache
def _shares(exponents: tuple[float, ...]) -> np.ndarray:
    """Combinations, as rows, whose slopes are orthogonal over the typical strains, each as large there as x itself."""
    nodes, weights = np.polynomial.legendre.leggauss(64)
    x = torch.from_numpy(TYPICAL_STRAIN * nodes)
    values = torch.stack(_slopes(x, exponents)).numpy()
    size = TYPICAL_STRAIN / np.sqrt(3.0)
    # sqrt(w/2) values^T = Q R: the rows of R^-T values are orthonormal
    _, upper = np.linalg.qr(np.sqrt(0.5 * weights)[:, None] * values.T)
    return size * np.linalg.inv(upper).T
