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
from pcnclaws.laws.operations import deviator, exp, maximum, norm, sqrt, trace, where
from pcnclaws.laws.parameters import FRICTION_ANGLE, POISSONS_RATIO, YIELD_STRESS, YOUNGS_MODULUS
from pcnclaws.laws.plasticity import strain_at_yield
from pcnclaws.tensors.tensor_types import Parameters

# The largest compression of the cap, as a strain tr h.
COMPACTION = 0.02
# For the root of a cubic, from a start near it: then to rounding.
NEWTON_STEPS = 8


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


class Hosford(Plasticity):
    """A metal between Tresca's and von Mises': sharper corners than a circle, rounder sides than a hexagon.

        ((|e1 - e2|^8 + |e2 - e3|^8 + |e1 - e3|^8)/2)^(1/8) <= L,   returned to radially,   tr h' = tr h

    with the principal values of dev h, and L such that |dev tau| = tau_Y in pure shear.
    source  Hosford 1972, "A generalized isotropic yield criterion", with the exponent of face-centred metals
    """

    physical_parameters = (YOUNGS_MODULUS, POISSONS_RATIO, YIELD_STRESS)

    def coefficients(self, parameters: Parameters) -> Mapping[str, Tensor]:
        """limit: the largest |dev h| in pure shear [-]."""
        return {"limit": strain_at_yield(parameters)}

    def strain_after_flow(self, h: Values, p: Any) -> Values:
        dev = deviator(h)
        differences = (dev[0] - dev[1], dev[1] - dev[2], dev[0] - dev[2])
        # of pure shear, (1, 0, -1)/sqrt(2): (1 + 1 + 2^8)/2 over sqrt(2)^8
        eighth = sum(d**8 for d in differences) * (8.0 / 129.0)
        flows = eighth > p.limit**8
        size = sqrt(sqrt(sqrt(where(flows, eighth, 1.0))))
        share = where(flows, 1.0 - p.limit / size, 0.0)
        return [strain - share * d for strain, d in zip(h, dev, strict=True)]


class MatsuokaNakai(Plasticity):
    """Friction with a smooth surface through Mohr-Coulomb's edges: I1 I2/I3 <= 9 + 8 tan(phi)^2, returned to radially.

        (k - 3) a r^2 - k b r^3 = k - 9,   a = J2/p^2,   b = J3/p^3,   k = 9 + 8 tan(phi)^2

    r     what is left of the deviator, by Newton's method; nothing is left, and no volume, where p is not compressive
    J2, J3  invariants of the deviator of the stress, positive in compression, and p its mean
    source  Matsuoka and Nakai 1974, "Stress-deformation and strength characteristics of soil under three different
            principal stresses"
    """

    physical_parameters = (YOUNGS_MODULUS, POISSONS_RATIO, FRICTION_ANGLE)

    def coefficients(self, parameters: Parameters) -> Mapping[str, Tensor]:
        """kappa: the largest I1 I2/I3. bulk: the pressure of a unit of compression over 2 mu."""
        lam, mu = lame_constants(parameters)
        tangent = torch.tan(parameters["friction_angle"] * (math.pi / 180.0))
        return {"kappa": 9.0 + 8.0 * tangent**2, "bulk": (lam + 2.0 / 3.0 * mu) / (2.0 * mu)}

    def strain_after_flow(self, h: Values, p: Any) -> Values:
        dev, volumetric = deviator(h), trace(h)
        pressed = volumetric < 0.0
        unit = where(pressed, -p.bulk * volumetric, 1.0)
        s = [-d / unit for d in dev]
        # beyond a strain of this ratio to the pressure the root is the same but for the scale
        a, b = 0.5 * (s[0] * s[0] + s[1] * s[1] + s[2] * s[2]), s[0] * s[1] * s[2]
        square, cube, constant = (p.kappa - 3.0) * a, p.kappa * b, p.kappa - 9.0
        sheared = square > 1e-12
        root = sqrt(constant / where(sheared, square, 1.0))
        for _ in range(NEWTON_STEPS):
            slope = 2.0 * square * root - 3.0 * cube * root * root
            steep = slope > 1e-12
            root = root - where(steep, (square * root**2 - cube * root**3 - constant) / where(steep, slope, 1.0), 0.0)
        share = where(sheared, where(root < 1.0, 1.0 - root, 0.0), 0.0)
        return [where(pressed, strain - share * d, 0.0) for strain, d in zip(h, dev, strict=True)]


def _like(name: str, elastic: Any, plastic: Any, ships: str) -> Material:
    """A material with the ranges and the test objects of one that ships."""
    other = material_named(ships)
    return Material(name, elastic, plastic, other.ranges, other.objects)


# Forms were chosen looking at the first four, the convex one at the cap, too. Ogden and the cap were kept for the end
# from the forms before it, the last two from the convex one.
FOREIGN = {
    one.name: one
    for one in (
        material_named("neo_hookean"),
        _like("mooney_rivlin", MooneyRivlin, None, "elasticity"),
        material_named("tresca"),
        _like("mohr_coulomb", StVKHencky, MohrCoulomb, "sand"),
        _like("ogden", Ogden, None, "elasticity"),
        _like("cap", StVKHencky, CappedDruckerPrager, "sand"),
        _like("hosford", StVKHencky, Hosford, "plasticine"),
        _like("matsuoka_nakai", StVKHencky, MatsuokaNakai, "sand"),
    )
}
