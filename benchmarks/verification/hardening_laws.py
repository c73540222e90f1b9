"""Laws from outside of the package that metals are compared with: Voce hardening, and Perzyna's viscoplasticity."""

import math
from collections.abc import Mapping
from typing import Any

from torch import Tensor

from pcnclaws.laws.base import Plasticity, Values
from pcnclaws.laws.elasticity import StVKHencky
from pcnclaws.laws.internal_variables import InternalVariable
from pcnclaws.laws.materials import Material
from pcnclaws.laws.moduli import lame_constants
from pcnclaws.laws.operations import deviator, exp, maximum, norm, where
from pcnclaws.laws.parameters import POISSONS_RATIO, YOUNGS_MODULUS, Parameter
from pcnclaws.tensors.tensor_types import Parameters


def _stress_parameter(name: str, symbol: str) -> Parameter:
    return Parameter(name, symbol, "Pa", lower_included=True, logarithmic=True, search=(1.0, 1e12), is_stress=True)


YIELD = _stress_parameter("uniaxial_yield_stress", "sigma_Y")
SATURATION = _stress_parameter("saturation_stress", "R")
RATE = Parameter("saturation_rate", "d", "-", lower_included=True, search=(1e-3, 1e3))
LINEAR = _stress_parameter("linear_hardening", "H")
REFERENCE = _stress_parameter("reference_stress", "sigma_0")
PLASTIC_STRAIN = InternalVariable("equivalent_plastic_strain")
# Newton steps; the equations are convex, so that none goes too far.
VOCE_ITERATIONS, PERZYNA_ITERATIONS = 5, 15


class VoceVonMises(Plasticity):
    """Isotropic hardening that saturates: sigma_eq <= sigma_Y + R (1 - exp(-d p)), p the equivalent plastic strain.

    Backward Euler: 3 mu dp + sigma_Y + R (1 - exp(-d (p + dp))) = sigma_eq of the trial strain.
    source  Voce 1948
    """

    physical_parameters = (YOUNGS_MODULUS, POISSONS_RATIO, YIELD, SATURATION, RATE)
    internal_variables = (PLASTIC_STRAIN,)

    def coefficients(self, parameters: Parameters) -> Mapping[str, Tensor]:
        _, mu = lame_constants(parameters)
        own = {name: parameters[name] for name in ("uniaxial_yield_stress", "saturation_stress", "saturation_rate")}
        return {"mu": mu, **own}

    def flow(self, h: Values, p: Any) -> tuple[Values, Mapping[str, Any]]:
        dev = deviator(h)
        shear, before = norm(dev), p.equivalent_plastic_strain
        trial, amount = 2.0 * p.mu * math.sqrt(1.5) * shear, 0.0 * p.mu
        for _ in range(VOCE_ITERATIONS):
            soft = p.saturation_stress * exp(-p.saturation_rate * (before + amount))
            excess = trial - 3.0 * p.mu * amount - p.uniaxial_yield_stress - p.saturation_stress + soft
            amount = maximum(amount + excess / (3.0 * p.mu + p.saturation_rate * soft), 0.0)
        return _flowed(h, dev, shear, amount), {"equivalent_plastic_strain": before + amount}


class PerzynaVonMises(Plasticity):
    """Viscoplasticity: the deviator of strain flows at the rate (f / sigma_0)^5, linear hardening.

    f = |dev tau| - sqrt(2/3) (sigma_Y + H p) is measured, as the rate is, in Frobenius norms. Backward Euler, for
    x = f / sigma_0: sigma_0 x + (2 mu + 2/3 H) dt x^5 = f of the trial strain.
    source  Perzyna 1966
    """

    physical_parameters = (YOUNGS_MODULUS, POISSONS_RATIO, YIELD, LINEAR, REFERENCE)
    internal_variables = (PLASTIC_STRAIN,)
    reads_time_step = True

    def flow(self, h: Values, p: Any) -> tuple[Values, Mapping[str, Any]]:
        dev = deviator(h)
        shear, before = norm(dev), p.equivalent_plastic_strain
        two_mu = p.youngs_modulus / (1.0 + p.poissons_ratio)
        trial = two_mu * shear - math.sqrt(2.0 / 3.0) * (p.uniaxial_yield_stress + p.linear_hardening * before)
        start = where(trial > 0.0, trial, 0.0) / p.reference_stress
        stiffness = (two_mu + 2.0 / 3.0 * p.linear_hardening) * p.time_step / p.reference_stress
        x = start
        for _ in range(PERZYNA_ITERATIONS):
            fourth = x * x * x * x
            x = x - (stiffness * fourth * x + x - start) / (5.0 * stiffness * fourth + 1.0)
        amount = math.sqrt(2.0 / 3.0) * p.time_step * x * x * x * x * x
        return _flowed(h, dev, shear, amount), {"equivalent_plastic_strain": before + amount}


def _flowed(h: Values, dev: Values, shear: Any, amount: Any) -> Values:
    """Strains whose deviator has flowed by an equivalent plastic strain."""
    share = math.sqrt(1.5) * amount / where(shear > 0.0, shear, 1.0)
    return [strain - share * d for strain, d in zip(h, dev, strict=True)]


_MODULI = {"youngs_modulus": (1e10, 2e11), "poissons_ratio": (0.2, 0.4), "uniaxial_yield_stress": (1e7, 1e8)}
VOCE = Material(
    "voce_metal",
    StVKHencky,
    VoceVonMises,
    {**_MODULI, "saturation_stress": (1e7, 1e8), "saturation_rate": (1.0, 20.0)},
)
PERZYNA = Material(
    "perzyna_metal",
    StVKHencky,
    PerzynaVonMises,
    {**_MODULI, "linear_hardening": (1e9, 1e10), "reference_stress": (1e8, 1e9)},
)
