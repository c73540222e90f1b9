"""The neural laws as the paper writes them: deformation features and physical parameters concatenated.

The paper (PC-NCLaws, section 3.2) gives the shape, two networks of three layers, 64 wide, with the parameters as
further inputs, and inherits the rest from NCLaws (Ma et al. 2023): features of stretch, shear and volume, a
rotation-equivariant output, a plastic network that adds a small change to the trial deformation. NCLaws feeds
singular values; here their symmetric functions carry the same information without a decomposition.

What the paper does not say, and what these laws need to be trained to the end (docs/training.md): strain enters and
leaves a network in units of its own size, stress is in units of E, and what a network says of an undeformed body is
taken away.
"""

import torch
from jaxtyping import Float
from torch import Tensor

from pcnclaws.compiled.stretch_law import FEATURES, OUTPUTS, SMALLEST, StretchLaw, stretch_law, stretch_law_serves
from pcnclaws.laws.base import Elasticity, Plasticity
from pcnclaws.laws.fixed_parameters import FixedParameters
from pcnclaws.laws.law import Law, count_pytorch
from pcnclaws.laws.materials import Material
from pcnclaws.laws.networks import ConditionalMLP, StandardisedParameters, strain_of_stress
from pcnclaws.laws.rotation import rotation_and_stretch
from pcnclaws.tensors.linalg3 import determinant, deviator, identity_like, matmul, safe_norm, trace, transpose
from pcnclaws.tensors.tensor_types import InternalValues, Matrices, Parameters, Scalars

# Strains below which a network sees their size, above which more and more their direction alone: of an elastic law, and
# of a plastic one without a yield stress, which would be a scale of its own.
ELASTIC_STRAIN, SMALL_STRAIN = 0.1, 1e-3
# Plastic strain of a step at an output of 1, in units of the strain before it.
PLASTIC_STEP = 0.1


class StretchNet(Law):
    """What both laws share: S = factor n (N(x / n, parameters) - N(0, parameters)), symmetric.

    x are features of the right stretch U of F = R U, N is the network, n = sqrt(unit^2 + x_0^2 + x_1^2) is the size of
    strain; the strain at which a material yields, n = tau_Y/(2 mu), where a plastic law knows of one.
    Without strain S is zero, whatever the weights are. An untrained S is zero at every strain.
    """

    def __init__(self, material: Material, parameter_names: tuple[str, ...], width: int) -> None:
        super().__init__()
        self.parameter_names = parameter_names
        self.form = StretchLaw(self.returns_strain, "yield_stress" not in parameter_names)
        self.condition = StandardisedParameters(material.ranges, parameter_names)
        self.network = ConditionalMLP(FEATURES + self.condition.count, OUTPUTS, width)

    def kernel_rows(self, parameters: Parameters) -> Float[Tensor, "rows particles"]:
        """What the law reads of the parameters: conditions, output at rest, unit of strain, factor of the output."""
        conditions = self.condition(parameters)
        at_rest = self.network(torch.cat((conditions.new_zeros(FEATURES, conditions.shape[1]), conditions)))
        return torch.cat((conditions, at_rest, torch.stack((self._unit(parameters), self._factor(parameters)))))

    def answer(
        self,
        deformation: Matrices,
        parameters: Parameters,
        internal: InternalValues | None = None,
        evaluated: bool = True,
    ) -> tuple[Matrices, InternalValues | None]:
        return self._computed(deformation, parameters), internal

    def _unit(self, parameters: Parameters) -> Scalars:
        if not self.form.own_size:
            return strain_of_stress("yield_stress", parameters)
        return torch.full_like(parameters["youngs_modulus"], SMALL_STRAIN if self.returns_strain else ELASTIC_STRAIN)

    def _factor(self, parameters: Parameters) -> Scalars:
        if self.returns_strain:
            return torch.full_like(parameters["youngs_modulus"], PLASTIC_STEP)
        return parameters["youngs_modulus"]

    def _computed(self, deformation: Matrices, parameters: Parameters) -> Matrices:
        """R S F^T, or F + R S for a law that returns strain."""
        rows = parameters.rows_of(self) if isinstance(parameters, FixedParameters) else None
        if rows is None:
            rows = self.kernel_rows(parameters)
        rows = rows.expand(-1, deformation.shape[-1])
        weights = self.network.all_weights
        if stretch_law_serves(deformation, rows, weights):
            return stretch_law(self.form, deformation, rows, weights)
        count_pytorch()
        rotation, stretch = rotation_and_stretch(deformation)
        at_rest, (unit, factor) = rows[-2 - OUTPUTS : -2], rows[-2:]
        x = features(stretch)
        size = (unit.square() + x[0].square() + x[1].square()).sqrt() if self.form.own_size else unit
        output = self.network(torch.cat((x / size, rows[: -2 - OUTPUTS]))) - at_rest
        turned = matmul(rotation, symmetric(factor * size * output))
        return deformation + turned if self.returns_strain else matmul(turned, transpose(deformation))


class PaperElasticNet(StretchNet, Elasticity):
    """First Piola-Kirchhoff stress P = R S, in units of Young's modulus; the unit of strain is that of the material."""

    def __init__(self, material: Material, width: int) -> None:
        super().__init__(material, material.elasticity.parameter_names, width)

    def kirchhoff_stress(self, deformation: Matrices, parameters: Parameters) -> Matrices:
        """Kirchhoff stress tau = P F^T [Pa], (3, 3, particles)."""
        return self._computed(deformation, parameters)


class PaperPlasticNet(StretchNet, Plasticity):
    """F' = F + R S, in units of PLASTIC_STEP times the size of strain."""

    def __init__(self, material: Material, width: int) -> None:
        if material.plasticity is None:
            raise ValueError(f"material '{material.name}' is purely elastic and has no plastic law")
        super().__init__(material, material.plasticity.parameter_names, width)

    def return_map(self, trial: Matrices, parameters: Parameters) -> Matrices:
        """Elastic deformation gradient after plastic flow [-], (3, 3, particles)."""
        return self._computed(trial, parameters)


def features(stretch: Matrices) -> Float[Tensor, "features particles"]:
    """The deformation features of a right stretch U, all of the order of strain e = U - I.

    Symmetric functions of the stretches, tr e, |dev e|, 3 sqrt(6) det(dev e)/|dev e|^2 and det U - 1; then the six
    components of e.
    """
    strain = stretch - identity_like(stretch)
    shear = deviator(strain)
    size = safe_norm(shear)
    third = 3.0 * 6.0**0.5 * determinant(shear) / (size.square() + SMALLEST)
    invariants = torch.stack((trace(strain), size, third, determinant(stretch) - 1.0))
    components = torch.stack((strain[0, 0], strain[1, 1], strain[2, 2], strain[0, 1], strain[0, 2], strain[1, 2]))
    return torch.cat((invariants, components))


def symmetric(components: Float[Tensor, "6 particles"]) -> Matrices:
    """The symmetric matrices with the components 11, 22, 33, 12, 13, 23."""
    a, b, c, ab, ac, bc = components.unbind(0)
    return torch.stack((a, ab, ac, ab, b, bc, ac, bc, c)).unflatten(0, (3, 3))
