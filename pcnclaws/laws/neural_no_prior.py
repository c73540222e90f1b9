"""Neural laws without the Hencky and modulus prior of the default variant, `model=pcnclaws_no_prior`.

Isotropy, no stress at rest and a plastic update that can only release Hencky energy stay; that E and nu are the moduli
of small strain and that tau_Y is a strain in units of 2 mu is no longer built in. What the structure alone gives is
one stiffness and one yield surface for all parameters: how they depend on them must be learned.
"""

from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn import functional

from pcnclaws.laws.base import Elasticity
from pcnclaws.laws.materials import Material
from pcnclaws.laws.networks import ConditionalMLP, StandardisedParameters
from pcnclaws.laws.neural_default import SOFTPLUS_ONE, STRAIN_SCALE, PlasticNet, bounded_invariants
from pcnclaws.linalg3 import deviator, hencky_strain, identity_like, matmul, trace
from pcnclaws.tensor_types import Matrices, Parameters, Scalars


class NoPriorElasticNet(Elasticity):
    """Isotropic elasticity whose every coefficient is learned.

    tau = S (a1 dev h + a2 dev((dev h)^2) + (a0 tr h + a3 |dev h|^2) I),   a0 = softplus(s + f0), a1 = softplus(s + f1)

    f, a2 = f2, a3 = f3 depend on the invariants of h and on all physical parameters; softplus(s) = 1. S is the middle
    of the range of Young's modulus, whatever the modulus of the scene: an untrained network is the Hencky law of one
    stiffness. The stress need not be the derivative of an energy.
    """

    kernel = "NoPriorElasticNet"

    def __init__(self, material: Material, width: int) -> None:
        super().__init__()
        self.parameter_names = material.elasticity.parameter_names
        self.condition = StandardisedParameters(material.ranges, self.parameter_names)
        self.network = ConditionalMLP(3 + self.condition.count, 4, width)
        self.stress_scale = material.defaults["youngs_modulus"]

    def kernel_parameters(self, parameters: Parameters) -> Sequence[Tensor]:
        scale = torch.full_like(parameters["youngs_modulus"], self.stress_scale)
        return scale, *self.condition(parameters)

    def kernel_weights(self) -> Sequence[Tensor]:
        return self.network.all_weights

    def kirchhoff_stress(self, deformation: Matrices, parameters: Parameters) -> Matrices:
        """Kirchhoff stress tau [Pa], (3, 3, particles), symmetric."""
        h = hencky_strain(deformation)
        dev, volumetric = deviator(h), trace(h)
        f = self.network(torch.cat((bounded_invariants(dev, volumetric), self.condition(parameters))))
        a0, a1 = functional.softplus(SOFTPLUS_ONE + f[:2])
        pressure = a0 * volumetric + f[3] * dev.square().sum((0, 1))
        return self.stress_scale * (a1 * dev + f[2] * deviator(matmul(dev, dev)) + identity_like(h) * pressure)


class NoPriorPlasticNet(PlasticNet):
    """The return of PlasticNet, whose network sees the physical parameters as they are.

    Limits are measured in one constant strain, and friction is a ratio of strains: the yield strain of a material that
    has a yield stress and what the moduli make of friction must be learned.
    """

    kernel = "PlasticNet"
    conditioning = StandardisedParameters

    def _unit(self, parameters: Parameters) -> Scalars:
        return torch.full_like(parameters["youngs_modulus"], STRAIN_SCALE)

    def _strain_for_stress(self, parameters: Parameters) -> Scalars:
        return torch.ones_like(parameters["youngs_modulus"])
