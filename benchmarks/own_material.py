"""A material from outside of the package, with laws and a parameter of its own: cohesive soil on a rubber."""

import math
from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from pcnclaws.laws.base import Elasticity, Plasticity, Values
from pcnclaws.laws.materials import Material
from pcnclaws.laws.moduli import lame_constants
from pcnclaws.laws.operations import deviator, exp, norm, trace, where
from pcnclaws.laws.parameters import FRICTION_ANGLE, POISSONS_RATIO, YOUNGS_MODULUS, Parameter
from pcnclaws.tensors.tensor_types import Parameters

COHESION = Parameter("cohesion", "c", "Pa", lower_included=True, logarithmic=True, search=(1.0, 1e6), is_stress=True)


class MooneyRivlin(Elasticity):
    """Compressible Mooney-Rivlin elasticity, of which only the energy is stated.

    c1 (J^(-2/3) I1 - 3) + c2 (J^(-4/3) I2 - 3) + K/2 (ln J)^2 with 2 (c1 + c2) = mu, c2 = c1/4
    source  Mooney 1940; Holzapfel 2000, "Nonlinear solid mechanics", section 6.5
    """

    physical_parameters = (YOUNGS_MODULUS, POISSONS_RATIO)

    def coefficients(self, parameters: Parameters) -> Mapping[str, Tensor]:
        lam, mu = lame_constants(parameters)
        return {"c1": 0.4 * mu, "c2": 0.1 * mu, "bulk": lam + 2.0 / 3.0 * mu}

    def principal_energy(self, h: Values, p: Any) -> Any:
        dev, volumetric = deviator(h), trace(h)
        squares = [exp(2.0 * d) for d in dev]
        first, second = sum(squares) - 3.0, sum(1.0 / square for square in squares) - 3.0
        return p.c1 * first + p.c2 * second + 0.5 * p.bulk * volumetric**2


class CohesiveDruckerPrager(Plasticity):
    """Friction and cohesion: |dev h| <= slope (tip - tr h), and tr h <= tip, the isotropic tension at c cot phi.

    source  Drucker and Prager 1952
    """

    physical_parameters = (YOUNGS_MODULUS, POISSONS_RATIO, FRICTION_ANGLE, COHESION)

    def coefficients(self, parameters: Parameters) -> Mapping[str, Tensor]:
        lam, mu = lame_constants(parameters)
        angle = parameters["friction_angle"] * (math.pi / 180.0)
        sine = torch.sin(angle)
        alpha = math.sqrt(2.0 / 3.0) * 2.0 * sine / (3.0 - sine)
        bulk = lam + 2.0 / 3.0 * mu
        return {"slope": 3.0 * bulk / (2.0 * mu) * alpha, "tip": parameters["cohesion"] / torch.tan(angle) / bulk}

    def strain_after_flow(self, h: Values, p: Any) -> Values:
        dev, volumetric = deviator(h), trace(h)
        shear = norm(dev)
        limit = p.slope * (p.tip - volumetric)
        share = where(shear > limit, 1.0 - limit / where(shear > limit, shear, 1.0), 0.0)
        return [where(volumetric > p.tip, p.tip / 3.0, strain - share * d) for strain, d in zip(h, dev, strict=True)]


SOIL = Material(
    "cohesive_soil",
    MooneyRivlin,
    CohesiveDruckerPrager,
    {
        "youngs_modulus": (2e5, 6e5),
        "poissons_ratio": (0.1, 0.4),
        "friction_angle": (18.0, 38.0),
        "cohesion": (5e2, 5e3),
    },
)
