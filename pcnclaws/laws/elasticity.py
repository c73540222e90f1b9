"""Analytic elasticity: the ground truth that neural laws are trained on and compared with."""

from collections.abc import Mapping
from typing import Any

from torch import Tensor

from pcnclaws.laws.base import Elasticity, Values
from pcnclaws.laws.moduli import lame_constants
from pcnclaws.laws.operations import exp, sum_of_squares, trace
from pcnclaws.laws.parameters import POISSONS_RATIO, YOUNGS_MODULUS
from pcnclaws.tensors.tensor_types import Parameters


class LameElasticity(Elasticity):
    """Elasticity with two moduli: its formulas read p.mu and p.lam, Lame's constants [Pa]."""

    physical_parameters = (YOUNGS_MODULUS, POISSONS_RATIO)

    def coefficients(self, parameters: Parameters) -> Mapping[str, Tensor]:
        lam, mu = lame_constants(parameters)
        return {"mu": mu, "lam": lam}


class FixedCorotated(LameElasticity):
    """Fixed corotated elasticity, the material of soft elastic bodies.

        tau = 2 mu (F - R) F^T + lambda J (J - 1) I,   energy mu |F - R|^2 + lambda/2 (J - 1)^2

    with the rotation R of F and J = det F; s = e^h are the principal stretches.

    source  Stomakhin et al. 2012, "Energetically consistent invertible elasticity"
    """

    def principal_stress(self, h: Values, p: Any) -> Values:
        s = [exp(strain) for strain in h]
        j = s[0] * s[1] * s[2]
        pressure = p.lam * j * (j - 1.0)
        return [2.0 * p.mu * stretch * (stretch - 1.0) + pressure for stretch in s]

    def principal_energy(self, h: Values, p: Any) -> Any:
        excess = [exp(strain) - 1.0 for strain in h]
        return p.mu * sum_of_squares(excess) + 0.5 * p.lam * (exp(trace(h)) - 1.0) ** 2


class NeoHookean(LameElasticity):
    """Compressible neo-Hookean elasticity, a rubber that the Hencky form of the neural laws does not contain.

        tau = mu (b - I) + lambda ln(J) I,   energy mu/2 (tr b - 3) - mu ln J + lambda/2 (ln J)^2

    with b = F F^T and J = det F.

    source  Bonet and Wood 2008, "Nonlinear continuum mechanics for finite element analysis", section 6.4.3, where it
            stands as the Cauchy stress tau / J
    """

    def principal_stress(self, h: Values, p: Any) -> Values:
        pressure = p.lam * trace(h)
        return [p.mu * (exp(2.0 * strain) - 1.0) + pressure for strain in h]

    def principal_energy(self, h: Values, p: Any) -> Any:
        volumetric = trace(h)
        squares = sum(exp(2.0 * strain) - 1.0 for strain in h)
        return 0.5 * p.mu * (squares - 2.0 * volumetric) + 0.5 * p.lam * volumetric**2


class StVKHencky(LameElasticity):
    """St. Venant-Kirchhoff elasticity in Hencky strain, the elastic part of sand and plasticine.

        tau = 2 mu h + lambda tr(h) I,   energy mu |h|^2 + lambda/2 (tr h)^2,   h = 1/2 log(F F^T)

    source  Klar et al. 2016, "Drucker-Prager elastoplasticity for sand animation"
    """

    def principal_stress(self, h: Values, p: Any) -> Values:
        pressure = p.lam * trace(h)
        return [2.0 * p.mu * strain + pressure for strain in h]

    def principal_energy(self, h: Values, p: Any) -> Any:
        return p.mu * sum_of_squares(h) + 0.5 * p.lam * trace(h) ** 2
