"""Materials whose laws are of other forms than the neural ones: rubbers, and soils and metals of other surfaces."""

import math
from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from benchmarks.mohr_coulomb import MohrCoulomb
from benchmarks.own_material import MooneyRivlin
from pcnclaws.laws.base import Elasticity, Plasticity, Values
from pcnclaws.laws.elasticity import StVKHencky
from pcnclaws.laws.materials import Material, material_named
from pcnclaws.laws.moduli import lame_constants
from pcnclaws.laws.operations import deviator, exp, maximum, norm, trace, where
from pcnclaws.laws.parameters import FRICTION_ANGLE, POISSONS_RATIO, YOUNGS_MODULUS
from pcnclaws.tensors.tensor_types import Parameters

# The largest compression of the cap, as a strain tr h.
COMPACTION = 0.02


class Ogden(Elasticity):
    """Ogden's rubber of three terms, of which only the energy is stated.

        sum_p m_p/a_p^2 (sum_i exp(a_p dev h_i) - 3) + K/2 (ln J)^2,   sum_p m_p = 2 mu

    source  Ogden 1972, whose exponents and moduli for vulcanised rubber these are, divided by their sum
    """

    physical_parameters = (YOUNGS_MODULUS, POISSONS_RATIO)
    exponents = (1.3, 5.0, -2.0)
    moduli = (0.63 * 1.3, 0.0012 * 5.0, 0.01 * 2.0)

    def coefficients(self, parameters: Parameters) -> Mapping[str, Tensor]:
        lam, mu = lame_constants(parameters)
        return {"two_mu": 2.0 * mu, "bulk": lam + 2.0 / 3.0 * mu}

    def principal_energy(self, h: Values, p: Any) -> Any:
        dev, whole = deviator(h), sum(self.moduli)
        terms = sum(
            m / whole / a**2 * (sum(exp(a * d) for d in dev) - 3.0)
            for a, m in zip(self.exponents, self.moduli, strict=True)
        )
        return p.two_mu * terms + 0.5 * p.bulk * trace(h) ** 2


class CappedDruckerPrager(Plasticity):
    """Friction without cohesion that bears a compression of COMPACTION at most: a cone with a flat cap.

        tr h' = max(tr h, -c),   |dev h'| <= -slope tr h'

    source  Drucker, Gibson and Henkel 1957, "Soil mechanics and work-hardening theories of plasticity"; without the
            hardening of the cap
    """

    physical_parameters = (YOUNGS_MODULUS, POISSONS_RATIO, FRICTION_ANGLE)

    def coefficients(self, parameters: Parameters) -> Mapping[str, Tensor]:
        lam, mu = lame_constants(parameters)
        sine = torch.sin(parameters["friction_angle"] * (math.pi / 180.0))
        alpha = math.sqrt(2.0 / 3.0) * 2.0 * sine / (3.0 - sine)
        return {"slope": (3.0 * lam + 2.0 * mu) / (2.0 * mu) * alpha}

    def strain_after_flow(self, h: Values, p: Any) -> Values:
        dev, volumetric = deviator(h), trace(h)
        shear, held = norm(dev), maximum(volumetric, -COMPACTION)
        limit = where(held < 0.0, -p.slope * held, 0.0)
        share = where(shear > limit, limit / where(shear > limit, shear, 1.0), 1.0)
        borne = where(volumetric > 0.0, 0.0, held) / 3.0
        return [share * d + borne for d in dev]


def _like(name: str, elastic: Any, plastic: Any, ships: str) -> Material:
    """A material with the ranges and the test objects of one that ships."""
    other = material_named(ships)
    return Material(name, elastic, plastic, other.ranges, other.objects)


# Forms were chosen looking at the first four; the last two were kept for the end.
FOREIGN = {
    one.name: one
    for one in (
        material_named("neo_hookean"),
        _like("mooney_rivlin", MooneyRivlin, None, "elasticity"),
        material_named("tresca"),
        _like("mohr_coulomb", StVKHencky, MohrCoulomb, "sand"),
        _like("ogden", Ogden, None, "elasticity"),
        _like("cap", StVKHencky, CappedDruckerPrager, "sand"),
    )
}
