"""NCLaws, the laws that PC-NCLaws start from: networks of the deformation of one object, without its parameters.

Ma et al. 2023, "Learning neural constitutive laws from motion observations for generalizable PDE dynamics".
"""

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from pcnclaws.baselines.polar import stretches_and_rotation
from pcnclaws.laws.analytic import Laws
from pcnclaws.laws.base import Elasticity, Plasticity
from pcnclaws.laws.materials import Material
from pcnclaws.tensors.linalg3 import determinant, identity_like, matmul, transpose
from pcnclaws.tensors.tensor_types import Matrices, Parameters

# Stretches less 1 (3), F^T F - I (9), det F - 1 (1).
FEATURES = 13
WIDTH = 64
# Weight of the plastic network's output.
PLASTIC_STEP = 1e-3


class NCLawsNetwork(nn.Module):
    """Three linear layers without biases, GELU between them, Xavier uniform weights; no normalisation.

    All features vanish at rest, and with them the output.
    """

    def __init__(self) -> None:
        super().__init__()
        sizes = ((WIDTH, FEATURES), (WIDTH, WIDTH), (9, WIDTH))
        self.weights = nn.ParameterList(nn.init.xavier_uniform_(torch.empty(size)) for size in sizes)

    def forward(self, deformation: Matrices) -> Matrices:
        """R sym(X) with the output X of the network and the rotation R of the deformation, (3, 3, particles)."""
        x, rotation = features_and_rotation(deformation)
        first, second, last = self.weights
        x = functional.gelu(second @ functional.gelu(first @ x))
        x = (last @ x).unflatten(0, (3, 3))
        return matmul(rotation, 0.5 * (x + transpose(x)))


class NCLawsElasticity(Elasticity):
    """P = R sym(X) [Pa]. Objective, but neither isotropic nor bound to a symmetric Kirchhoff stress."""

    def __init__(self, material: Material) -> None:
        super().__init__()
        self.parameter_names = material.elasticity.parameter_names
        self.network = NCLawsNetwork()

    def kirchhoff_stress(self, deformation: Matrices, parameters: Parameters) -> Matrices:
        """Kirchhoff stress tau = P F^T [Pa], (3, 3, particles), whatever the parameters are."""
        return matmul(self.network(deformation), transpose(deformation))


class NCLawsPlasticity(Plasticity):
    """F' = F + 0.001 R sym(X)."""

    def __init__(self, material: Material) -> None:
        super().__init__()
        if material.plasticity is None:
            raise ValueError(f"material '{material.name}' is purely elastic and has no plastic law")
        self.parameter_names = material.plasticity.parameter_names
        self.network = NCLawsNetwork()

    def return_map(self, trial: Matrices, parameters: Parameters) -> Matrices:
        """Elastic deformation gradient after plastic flow [-], (3, 3, particles), whatever the parameters are."""
        return trial + PLASTIC_STEP * self.network(trial)


def nclaws(material: Material) -> Laws:
    """Untrained NCLaws of a material; a purely elastic one gets no plastic network."""
    return Laws(NCLawsElasticity(material), NCLawsPlasticity(material) if material.plasticity else None)


def features_and_rotation(deformation: Matrices) -> tuple[Float[Tensor, "features particles"], Matrices]:
    """The 13 features of NCLaws and the rotation R of the polar decomposition."""
    stretches, rotation = stretches_and_rotation(deformation)
    shear = (matmul(transpose(deformation), deformation) - identity_like(deformation)).flatten(0, 1)
    volume = determinant(deformation)[None]
    return torch.cat((stretches - 1.0, shear, volume - 1.0)), rotation
