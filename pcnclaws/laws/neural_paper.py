"""The neural laws as the paper writes them: deformation features and physical parameters concatenated.

The paper (PC-NCLaws, section 3.2) gives the shape, two networks of three layers, 64 wide, with the parameters as
further inputs, and inherits the rest from NCLaws (Ma et al. 2023): features of stretch, shear and volume, a
rotation-equivariant output, a plastic network that adds a small change to the trial deformation. NCLaws feeds
singular values; here their symmetric functions carry the same information without a decomposition.
"""

import torch
from torch import Tensor

from pcnclaws.laws.base import Elasticity, Plasticity
from pcnclaws.laws.materials import Material
from pcnclaws.laws.networks import ConditionalMLP, StandardisedParameters
from pcnclaws.linalg3 import determinant, identity_like, inverse, left_stretch, matmul, trace, transpose
from pcnclaws.tensor_types import Matrices, Parameters

# Weight of the plastic network's output, as in NCLaws.
PLASTIC_STEP = 1e-3


class PaperElasticNet(Elasticity):
    """P = R sym(X) E0 with X the output of the network and E0 the middle of the range of Young's modulus."""

    def __init__(self, material: Material, width: int) -> None:
        super().__init__()
        self.parameter_names = material.elasticity.parameter_names
        self.condition = StandardisedParameters(material.ranges, self.parameter_names)
        self.network = ConditionalMLP(FEATURES + len(self.parameter_names), 9, width, zero_start=False)
        self.stress_scale = material.defaults["youngs_modulus"]

    def kirchhoff_stress(self, deformation: Matrices, parameters: Parameters) -> Matrices:
        """Kirchhoff stress tau = P F^T [Pa], (3, 3, particles)."""
        features, rotation = features_and_rotation(deformation)
        x = self.network(torch.cat((features, self.condition(parameters)))).unflatten(0, (3, 3))
        first_piola = self.stress_scale * matmul(rotation, 0.5 * (x + transpose(x)))
        return matmul(first_piola, transpose(deformation))


class PaperPlasticNet(Plasticity):
    """F' = F + 0.001 R X with X the output of the network."""

    def __init__(self, material: Material, width: int) -> None:
        super().__init__()
        if material.plasticity is None:
            raise ValueError(f"material '{material.name}' is purely elastic and has no plastic law")
        self.parameter_names = material.plasticity.parameter_names
        self.condition = StandardisedParameters(material.ranges, self.parameter_names)
        self.network = ConditionalMLP(FEATURES + len(self.parameter_names), 9, width, zero_start=False)

    def return_map(self, trial: Matrices, parameters: Parameters) -> Matrices:
        """Elastic deformation gradient after plastic flow [-], (3, 3, particles)."""
        features, rotation = features_and_rotation(trial)
        x = self.network(torch.cat((features, self.condition(parameters)))).unflatten(0, (3, 3))
        return trial + PLASTIC_STEP * matmul(rotation, x)


FEATURES = 13


def features_and_rotation(deformation: Matrices) -> tuple[Tensor, Matrices]:
    """The 13 deformation features and the rotation R of F = V R.

    Symmetric functions of the stretches less their value at rest (3: tr V - 3, tr adj V - 3, tr b - 3),
    F^T F - I (9), det F - 1 (1).
    """
    v, b = left_stretch(deformation)
    v, b = v.to(deformation.dtype), b.to(deformation.dtype)
    volume = determinant(deformation)
    second = 0.5 * (trace(v).square() - trace(b))
    stretches = torch.stack((trace(v) - 3.0, second - 3.0, trace(b) - 3.0, volume - 1.0))
    shear = (matmul(transpose(deformation), deformation) - identity_like(deformation)).flatten(0, 1)
    return torch.cat((stretches, shear)), matmul(inverse(v), deformation)
