"""The default variant of the neural laws, `model=pcnclaws`.

It puts into the structure what mechanics already knows: it is isotropic, dimensionless, free of
stress at rest, keeps E and nu as the moduli of small strain, and its plastic update can release but never store
Hencky energy, so that a rollout cannot blow up. The networks learn what is left: how the stiffness changes with
strain, and the shape of the yield surface.
"""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from pcnclaws.laws.base import Elasticity, Plasticity
from pcnclaws.laws.materials import Material
from pcnclaws.laws.networks import ConditionalMLP, DimensionlessParameters, StandardisedParameters, yield_strain
from pcnclaws.laws.parameters import lame_constants
from pcnclaws.linalg3 import (
    determinant,
    deviator,
    hencky_strain,
    identity_like,
    matmul,
    safe_norm,
    stretched,
    trace,
)
from pcnclaws.tensor_types import Matrices, Parameters, Scalars

# Strains are divided by this before they enter a network: the inputs are then of order one in soft bodies.
STRAIN_SCALE = 0.1
# Cohesion and tensile limit of the untrained law, as strains, where the material has no yield stress to scale them
# with: such a material knows no stress beside its moduli, and is nearly free of cohesion unless training finds some.
REFERENCE_YIELD_STRAIN = 1e-4
# softplus(SOFTPLUS_ONE) = 1
SOFTPLUS_ONE = 0.5413248546129181


class ElasticNet(Elasticity):
    """Isotropic elasticity whose stiffness depends on strain through a network.

    tau = 2 mu (g1 dev h + g2 dev(h^2)) + (K g0 tr h + 2 mu g3 |dev h|^2) I,   g0 = softplus(f0), g1 = softplus(f1)

    f, g2, g3 depend on the invariants of h and on nu; at zero strain g0 = g1 = 1, so E and nu are the moduli of
    small strain. An untrained network is the Hencky law, and so is a trained one at strains far above 1, where no
    data says what a network may make up: it fades away, lest a body without stiffness turns inside out. The stress
    need not be the derivative of an energy.
    """

    kernel = "ElasticNet"

    def __init__(self, material: Material, width: int) -> None:
        super().__init__()
        self.parameter_names = material.elasticity.parameter_names
        self.condition = DimensionlessParameters(material.ranges, self.parameter_names)
        self.network = ConditionalMLP(3 + self.condition.count, 6, width)

    def kernel_parameters(self, parameters: Parameters) -> Sequence[Tensor]:
        lam, mu = lame_constants(parameters)
        return mu, lam, *self.condition(parameters)

    def kernel_weights(self) -> Sequence[Tensor]:
        return self.network.all_weights

    def kirchhoff_stress(self, deformation: Matrices, parameters: Parameters) -> Matrices:
        """Kirchhoff stress tau [Pa], (3, 3, particles), symmetric."""
        lam, mu = lame_constants(parameters)
        h = hencky_strain(deformation)
        dev, volumetric = deviator(h), trace(h)
        shear_squared = dev.square().sum((0, 1))
        strain = bounded_invariants(dev, volumetric)
        f = familiarity(h) * self.network(torch.cat((strain, self.condition(parameters))))

        g0 = functional.softplus(SOFTPLUS_ONE + f[0] * strain[0] + f[1] * strain[1])
        g1 = functional.softplus(SOFTPLUS_ONE + f[2] * strain[0] + f[3] * strain[1])
        pressure = (lam + 2.0 / 3.0 * mu) * g0 * volumetric + 2.0 * mu * f[5] * shear_squared
        shear = 2.0 * mu * g1 * dev + 2.0 * mu * f[4] * deviator(matmul(dev, dev))
        return shear + identity_like(h) * pressure


def familiarity(h: Matrices) -> Scalars:
    """How much a network is believed, 1/(1 + 4 max(|h|^2 - 2, 0)^2): 1 to the last bit at strains |h| below 1.4."""
    return 1.0 / (1.0 + 4.0 * (h.square().sum((0, 1)) - 2.0).clamp_min(0.0).square())


def bounded_invariants(dev: Matrices, volumetric: Scalars) -> Float[Tensor, "3 particles"]:
    """tr h, |dev h|^2 and det dev h as inputs of a network.

    Bounded: beyond a strain of order one the stiffness is held, not extrapolated.
    """
    shear_squared = dev.square().sum((0, 1)) / STRAIN_SCALE**2
    strain = torch.stack((volumetric / STRAIN_SCALE, shear_squared, determinant(dev) / STRAIN_SCALE**3))
    return strain / (1.0 + strain.square() / 100.0).sqrt()


class PlasticNet(Plasticity):
    """Radial return to a yield surface that a network describes.

        tr h' = min(tr h, t),   |dev h'| = min(|dev h|, c + k K/(2 mu) max(-tr h', 0)),   F' = exp(h' - h) F

    with the tensile limit t, cohesion c and friction k, all at least 0, from a network of the direction of strain and
    of the physical parameters. K/(2 mu) makes k a ratio of stresses, |dev tau| over pressure, as friction is. Inside
    the surface F' = F to the last bit: there is no creep. Both |dev h| and |tr h| can only shrink, so that the Hencky
    energy can only be released.
    """

    kernel = "PlasticNet"
    conditioning: type[StandardisedParameters] = DimensionlessParameters
    outputs = 3  # of the network

    def __init__(self, material: Material, width: int) -> None:
        super().__init__()
        if material.plasticity is None:
            raise ValueError(f"material '{material.name}' is purely elastic and has no plastic law")
        self.parameter_names = material.plasticity.parameter_names
        self.condition = self.conditioning(material.ranges, self.parameter_names)
        self.network = ConditionalMLP(2 + self.condition.count, self.outputs, width)

    def kernel_parameters(self, parameters: Parameters) -> Sequence[Tensor]:
        return self._unit(parameters), self._strain_for_stress(parameters), *self.condition(parameters)

    def kernel_weights(self) -> Sequence[Tensor]:
        return self.network.all_weights

    def return_map(self, trial: Matrices, parameters: Parameters) -> Matrices:
        """Elastic deformation gradient after plastic flow [-], (3, 3, particles)."""
        h = hencky_strain(trial)
        dev, volumetric = deviator(h), trace(h)
        shear = safe_norm(dev)
        f = self.network(torch.cat((_direction(dev, volumetric, shear), self.condition(parameters))))
        unit = self._unit(parameters)
        tension, cohesion, friction = self._surface(f, parameters)

        volumetric_after = torch.minimum(volumetric, unit * tension)
        limit = unit * cohesion + friction * (-volumetric_after).clamp_min(0.0)
        flow = torch.where(shear > limit, self._flow(dev, shear, limit, f), 0.0)
        flow = flow + identity_like(h) * ((volumetric_after - volumetric) / 3.0)
        return stretched(flow, trial)

    def _flow(self, dev: Matrices, shear: Scalars, limit: Scalars, f: Tensor) -> Matrices:
        """What a particle that yields adds to dev h: it goes straight back to the surface."""
        return (limit / torch.where(shear > limit, shear, 1.0) - 1.0) * dev

    def _unit(self, parameters: Parameters) -> Scalars:
        """The strain that tensile limit and cohesion are measured in."""
        if "yield_stress" in self.parameter_names:
            return yield_strain(parameters)
        return torch.full_like(parameters["youngs_modulus"], REFERENCE_YIELD_STRAIN)

    def _strain_for_stress(self, parameters: Parameters) -> Scalars:
        """Shear strain over volumetric strain where |dev tau| equals the pressure, K/(2 mu) [-]."""
        lam, mu = lame_constants(parameters)
        return (lam + 2.0 / 3.0 * mu) / (2.0 * mu)

    def _surface(self, f: Float[Tensor, "outputs particles"], parameters: Parameters) -> tuple[Tensor, ...]:
        """Tensile limit, cohesion (both in yield strains) and friction (in strains)."""
        # squares reach 0, where the logarithm of a limit would have to travel for ever
        tension, cohesion = (1.0 + 4.0 * f[:2]).square()
        friction = functional.softplus(SOFTPLUS_ONE + 4.0 * f[2])
        return tension, cohesion, self._strain_for_stress(parameters) * friction


def _direction(dev: Matrices, volumetric: Scalars, shear: Scalars) -> Float[Tensor, "2 particles"]:
    """Where a strain points, whatever its size: its share of volume, and its shear from extension to compression."""
    size = (shear.square() + volumetric.square() + 1e-8).sqrt()
    return torch.stack((volumetric / size, 3.0 * determinant(dev) * 6.0**0.5 / (shear + 1e-4).pow(3)))
