"""Neural laws without the Hencky and modulus prior of the default variant, `model=pcnclaws_no_prior`.

Isotropy, no stress at rest and a plastic update that can only release Hencky energy stay; that E and nu are the moduli
of small strain and that tau_Y is a strain in units of 2 mu is no longer built in. What the structure alone gives is
one stiffness and one yield surface for all parameters: how they depend on them must be learned.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor

from pcnclaws.laws.base import Elasticity, Values
from pcnclaws.laws.materials import Material
from pcnclaws.laws.networks import ConditionalMLP, StandardisedParameters
from pcnclaws.laws.neural_default import SOFTPLUS_ONE, STRAIN_SCALE, PlasticNet, bounded_invariants
from pcnclaws.laws.operations import deviator, softplus, sum_of_squares, trace
from pcnclaws.tensors.tensor_types import Parameters, Scalars


class NoPriorElasticNet(Elasticity):
    """Isotropic elasticity whose every coefficient is learned.

    tau = S (a1 dev h + a2 dev((dev h)^2) + (a0 tr h + a3 |dev h|^2) I),   a0 = softplus(s + f0), a1 = softplus(s + f1)

    f, a2 = f2, a3 = f3 depend on the invariants of h and on all physical parameters; softplus(s) = 1. S is the middle
    of the range of Young's modulus, whatever the modulus of the scene: an untrained network is the Hencky law of one
    stiffness. The stress need not be the derivative of an energy.
    """

    def __init__(self, material: Material, width: int) -> None:
        super().__init__()
        self.parameter_names = material.elasticity.parameter_names
        self.condition = StandardisedParameters(material.ranges, self.parameter_names)
        self.network = ConditionalMLP(3 + self.condition.count, 4, width)
        self.stress_scale = material.defaults["youngs_modulus"]

    def coefficients(self, parameters: Parameters) -> Mapping[str, Tensor]:
        return {"scale": torch.full_like(parameters["youngs_modulus"], self.stress_scale)}

    def conditions(self, parameters: Parameters) -> Sequence[Tensor]:
        return self.condition(parameters).unbind(0)

    def features(self, h: Values) -> Values:
        return bounded_invariants(h)

    def respond(self, h: Values, p: Any, x: Values, f: Values) -> Values:
        dev = deviator(h)
        shear_squared = sum_of_squares(dev)
        third = shear_squared / 3.0
        a0, a1 = (softplus(f[k] + SOFTPLUS_ONE) for k in range(2))
        pressure = a0 * trace(h) + f[3] * shear_squared
        return [p.scale * (a1 * d + f[2] * (d * d - third) + pressure) for d in dev]


class NoPriorPlasticNet(PlasticNet):
    """The return of PlasticNet, whose network sees the physical parameters as they are.

    Limits are measured in one constant strain, and friction is a ratio of strains: the yield strain of a material that
    has a yield stress and what the moduli make of friction must be learned.
    """

    conditioning = StandardisedParameters

    def _unit(self, parameters: Parameters) -> Scalars:
        return torch.full_like(parameters["youngs_modulus"], STRAIN_SCALE)

    def _strain_for_stress(self, parameters: Parameters) -> Scalars:
        return torch.ones_like(parameters["youngs_modulus"])
