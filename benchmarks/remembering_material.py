"""Materials from outside of the package whose laws remember, take time, and resist being sheared quickly."""

from collections.abc import Mapping
from typing import Any

from torch import Tensor

from pcnclaws.laws.base import Elasticity, Plasticity, Values
from pcnclaws.laws.elasticity import StVKHencky
from pcnclaws.laws.internal_variables import InternalVariable
from pcnclaws.laws.materials import Material
from pcnclaws.laws.moduli import lame_constants
from pcnclaws.laws.operations import deviator, exp, norm, sum_of_squares, trace, where
from pcnclaws.laws.parameters import POISSONS_RATIO, YIELD_STRESS, YOUNGS_MODULUS, Parameter
from pcnclaws.laws.viscosity import NewtonianViscosity
from pcnclaws.tensors.tensor_types import Parameters

HARDENING = Parameter("hardening_modulus", "H", "Pa", lower_included=True, logarithmic=True, search=(1e2, 1e8))
RELAXATION_TIME = Parameter("relaxation_time", "t_r", "s", logarithmic=True, search=(1e-4, 1e2))

PLASTIC_STRAIN = InternalVariable("plastic_strain")
SOFTNESS = InternalVariable("softness", start=1.0)


class HardeningVonMises(Plasticity):
    """Linear isotropic hardening: |dev tau| <= tau_Y + H a, where a adds up how far dev h has flowed.

        dgamma = max(2 mu |dev h| - tau_Y - H a, 0)/(2 mu + H),  dev h' = dev h (1 - dgamma/|dev h|),  a' = a + dgamma

    source  Simo and Hughes 1998, "Computational inelasticity", section 3.3
    """

    physical_parameters = (YOUNGS_MODULUS, POISSONS_RATIO, YIELD_STRESS, HARDENING)
    internal_variables = (PLASTIC_STRAIN,)

    def coefficients(self, parameters: Parameters) -> Mapping[str, Tensor]:
        _, mu = lame_constants(parameters)
        hardening = parameters["hardening_modulus"]
        return {"two_mu": 2.0 * mu, "limit": parameters["yield_stress"], "hardening": hardening}

    def flow(self, h: Values, p: Any) -> tuple[Values, Mapping[str, Any]]:
        dev = deviator(h)
        shear = norm(dev)
        excess = p.two_mu * shear - p.limit - p.hardening * p.plastic_strain
        amount = where(excess > 0.0, excess, 0.0) / (p.two_mu + p.hardening)
        share = amount / where(shear > 0.0, shear, 1.0)
        return [strain - share * d for strain, d in zip(h, dev, strict=True)], {
            "plastic_strain": p.plastic_strain + amount
        }


class Relaxing(Plasticity):
    """Maxwell fluid: dev h decays by e^(-dt / t_r) a step. It also remembers how much it has been worked."""

    physical_parameters = (RELAXATION_TIME,)
    internal_variables = (SOFTNESS,)
    reads_time_step = True

    def flow(self, h: Values, p: Any) -> tuple[Values, Mapping[str, Any]]:
        dev = deviator(h)
        share = 1.0 - exp(-p.time_step / p.relaxation_time)
        softness = p.softness * exp(-0.1 * share * sum_of_squares(dev))
        return [strain - share * d for strain, d in zip(h, dev, strict=True)], {"softness": softness}


class SofteningHencky(Elasticity):
    """Hencky elasticity whose shear modulus falls with the softness that a plastic law keeps."""

    physical_parameters = (YOUNGS_MODULUS, POISSONS_RATIO)
    internal_variables = (SOFTNESS,)

    def coefficients(self, parameters: Parameters) -> Mapping[str, Tensor]:
        lam, mu = lame_constants(parameters)
        return {"lam": lam, "mu": mu}

    def principal_energy(self, h: Values, p: Any) -> Any:
        return p.softness * p.mu * sum_of_squares(deviator(h)) + (p.lam / 2.0 + p.mu / 3.0) * trace(h) ** 2


_MODULI = {"youngs_modulus": (1e5, 3e5), "poissons_ratio": (0.1, 0.4)}
CLAY = Material(
    "clay",
    StVKHencky,
    HardeningVonMises,
    {**_MODULI, "yield_stress": (1e3, 3e3), "hardening_modulus": (1e4, 5e4)},
)
PUTTY = Material(
    "putty",
    SofteningHencky,
    Relaxing,
    {**_MODULI, "relaxation_time": (0.01, 0.1), "viscosity": (1.0, 5.0)},
    viscous=NewtonianViscosity,
)
