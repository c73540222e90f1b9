"""The unified material: elasticity, plasticine and sand in one, and what lies between them.

How much of plasticine and of sand is in it are two more physical parameters; elasticity has what they leave. Where one
of the three is 1 the law is that of this kind. In between, stress, and what plastic flow does to the strain in a step,
are the means of those of the kinds, by their shares: a way from kind to kind that stays bounded, and no known body.
"""

from collections.abc import Mapping
from typing import Any

from torch import Tensor

from pcnclaws.laws.base import Plasticity, Values
from pcnclaws.laws.elasticity import FixedCorotated, LameElasticity, StVKHencky
from pcnclaws.laws.parameters import (
    FRICTION_ANGLE,
    PLASTICINE_SHARE,
    POISSONS_RATIO,
    SAND_SHARE,
    YIELD_STRESS,
    YOUNGS_MODULUS,
)
from pcnclaws.laws.plasticity import DruckerPrager, VonMises
from pcnclaws.tensors.tensor_types import Parameters, Scalars

_SOFT, _METAL, _GRAINS, _HENCKY = FixedCorotated(), VonMises(), DruckerPrager(), StVKHencky()


def shares(parameters: Parameters) -> tuple[Scalars, Scalars]:
    """How much of plasticine and of sand is in each particle [-]; elasticity has the rest.

    Shares that add up to more than 1 are divided by their sum.
    """
    plasticine, sand = parameters[PLASTICINE_SHARE.name], parameters[SAND_SHARE.name]
    total = (plasticine + sand).clamp_min(1.0)
    return plasticine / total, sand / total


class UnifiedElasticity(LameElasticity):
    """Fixed corotated elasticity where neither plasticine nor sand is, StVK in Hencky strain where nothing else is.

    tau = (1 - w) tau_FixedCorotated + w tau_Hencky,   w = the shares of plasticine and sand together

    and the same of the energies.
    """

    physical_parameters = (YOUNGS_MODULUS, POISSONS_RATIO, PLASTICINE_SHARE, SAND_SHARE)

    def coefficients(self, parameters: Parameters) -> Mapping[str, Tensor]:
        plasticine, sand = shares(parameters)
        return {**super().coefficients(parameters), "hencky": plasticine + sand}

    def principal_stress(self, h: Values, p: Any) -> Values:
        soft, hencky = (law.principal_stress(h, p) for law in (_SOFT, _HENCKY))
        return [(1.0 - p.hencky) * one + p.hencky * other for one, other in zip(soft, hencky, strict=True)]

    def principal_energy(self, h: Values, p: Any) -> Any:
        return (1.0 - p.hencky) * _SOFT.principal_energy(h, p) + p.hencky * _HENCKY.principal_energy(h, p)


class UnifiedPlasticity(Plasticity):
    """The flow of von Mises and that of Drucker-Prager, each by its share; neither of them in an elastic body.

        h' = h + p (h'_VonMises - h) + s (h'_DruckerPrager - h)

    with the shares p of plasticine and s of sand. It releases Hencky energy, as both do. Between kinds a second return
    flows on: strain nears the yield surface from step to step, and how fast depends on the time step.
    """

    physical_parameters = (
        *(YOUNGS_MODULUS, POISSONS_RATIO, YIELD_STRESS, FRICTION_ANGLE),
        *(PLASTICINE_SHARE, SAND_SHARE),
    )

    def coefficients(self, parameters: Parameters) -> Mapping[str, Tensor]:
        plasticine, sand = shares(parameters)
        return {
            **_METAL.coefficients(parameters),
            **_GRAINS.coefficients(parameters),
            "plasticine": plasticine,
            "sand": sand,
        }

    def strain_after_flow(self, h: Values, p: Any) -> Values:
        return mixed_flow(h, (p.plasticine, _METAL.strain_after_flow(h, p)), (p.sand, _GRAINS.strain_after_flow(h, p)))


def mixed_flow(h: Values, *flows: tuple[Any, Values]) -> Values:
    """Strains after the shares of some flows [-]: exactly h where none of them changes it, or none has a share.

    flows  the share and the strains after the flow of each [-]
    """
    return [strain + sum(share * (after[k] - strain) for share, after in flows) for k, strain in enumerate(h)]
