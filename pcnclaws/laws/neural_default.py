"""The default variant of the neural laws, `model=pcnclaws`.

It puts into the structure what mechanics already knows: it is isotropic, dimensionless, free of
stress at rest, keeps E and nu as the moduli of small strain, and its plastic update can release but never store
Hencky energy, so that a rollout cannot blow up. The networks learn what is left: how the stiffness changes with
strain, and the shape of the yield surface.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor

from pcnclaws.laws.base import Elasticity, Plasticity, Values
from pcnclaws.laws.materials import Material
from pcnclaws.laws.moduli import lame_constants
from pcnclaws.laws.networks import ConditionalMLP, DimensionlessParameters, StandardisedParameters, strain_of_stress
from pcnclaws.laws.operations import deviator, maximum, norm, softplus, sqrt, sum_of_squares, trace, where
from pcnclaws.tensors.tensor_types import Parameters, Scalars

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

    def __init__(self, material: Material, width: int) -> None:
        super().__init__()
        self.parameter_names = material.elasticity.parameter_names
        self.condition = DimensionlessParameters(material.ranges, self.parameter_names)
        self.network = ConditionalMLP(3 + self.condition.count, 6, width)

    def coefficients(self, parameters: Parameters) -> Mapping[str, Tensor]:
        lam, mu = lame_constants(parameters)
        return {"mu": mu, "lam": lam}

    def conditions(self, parameters: Parameters) -> Sequence[Tensor]:
        return self.condition(parameters).unbind(0)

    def features(self, h: Values) -> Values:
        return bounded_invariants(h)

    def respond(self, h: Values, p: Any, x: Values, f: Values) -> Values:
        dev = deviator(h)
        shear_squared, two_mu, known = sum_of_squares(dev), 2.0 * p.mu, familiarity(h)
        third = shear_squared / 3.0
        g0 = softplus(known * (f[0] * x[0] + f[1] * x[1]) + SOFTPLUS_ONE)
        g1 = softplus(known * (f[2] * x[0] + f[3] * x[1]) + SOFTPLUS_ONE)
        pressure = (p.lam + two_mu / 3.0) * g0 * trace(h) + two_mu * known * f[5] * shear_squared
        return [two_mu * (g1 * d + known * f[4] * (d * d - third)) + pressure for d in dev]


def familiarity(h: Values) -> Any:
    """How much a network is believed, 1/(1 + 4 max(|h|^2 - 2, 0)^2): 1 to the last bit at strains |h| below 1.4."""
    beyond = maximum(sum_of_squares(h) - 2.0, _zero(h[0]))
    return 1.0 / (1.0 + 4.0 * beyond * beyond)


def bounded_invariants(h: Values) -> Values:
    """tr h, |dev h|^2 and det dev h as inputs of a network.

    Bounded: beyond a strain of order one the stiffness is held, not extrapolated.
    """
    dev = deviator(h)
    invariants = (
        trace(h) / STRAIN_SCALE,
        sum_of_squares(dev) / STRAIN_SCALE**2,
        dev[0] * dev[1] * dev[2] / STRAIN_SCALE**3,
    )
    return [x / sqrt(1.0 + x * x / 100.0) for x in invariants]


class PlasticNet(Plasticity):
    """Radial return to a yield surface that a network describes.

        tr h' = min(tr h, t),   |dev h'| = min(|dev h|, c + k K/(2 mu) max(-tr h', 0)),   F' = exp(h' - h) F

    with the tensile limit t, cohesion c and friction k, all at least 0, from a network of the direction of strain and
    of the physical parameters. K/(2 mu) makes k a ratio of stresses, |dev tau| over pressure, as friction is. Inside
    the surface F' = F to the last bit: there is no creep. Both |dev h| and |tr h| can only shrink, so that the Hencky
    energy can only be released.
    """

    conditioning: type[StandardisedParameters] = DimensionlessParameters
    outputs = 3  # of the network

    def __init__(self, material: Material, width: int) -> None:
        super().__init__()
        if material.plasticity is None:
            raise ValueError(f"material '{material.name}' is purely elastic and has no plastic law")
        self.parameter_names = material.plasticity.parameter_names
        self.condition = self.conditioning(material.ranges, self.parameter_names)
        self.network = ConditionalMLP(2 + self.condition.count, self.outputs, width)

    def coefficients(self, parameters: Parameters) -> Mapping[str, Tensor]:
        return {"unit": self._unit(parameters), "strain_for_stress": self._strain_for_stress(parameters)}

    def conditions(self, parameters: Parameters) -> Sequence[Tensor]:
        return self.condition(parameters).unbind(0)

    def features(self, h: Values) -> Values:
        """Where a strain points, whatever its size: its share of volume, and shear from extension to compression."""
        dev, volumetric = deviator(h), trace(h)
        shear = norm(dev)
        softened = shear + 1e-4
        size = sqrt(shear * shear + volumetric * volumetric + 1e-8)
        return [volumetric / size, 3.0 * 6.0**0.5 * dev[0] * dev[1] * dev[2] / (softened * softened * softened)]

    def respond(self, h: Values, p: Any, x: Values, f: Values) -> Values:
        dev, volumetric = deviator(h), trace(h)
        shear = norm(dev)
        # squares reach 0, where the logarithm of a limit would have to travel for ever
        tension, cohesion = (p.unit * ((1.0 + 4.0 * f[k]) * (1.0 + 4.0 * f[k])) for k in range(2))
        friction = p.strain_for_stress * softplus(4.0 * f[2] + SOFTPLUS_ONE)

        after = where(volumetric > tension, tension, volumetric)
        limit = cohesion + friction * where(after < 0.0, -after, 0.0)
        yields = shear > limit
        mean = (after - volumetric) / 3.0
        flow = self._flow(dev, where(yields, shear, 1.0), limit, f)
        return [strain + (where(yields, change, 0.0) + mean) for strain, change in zip(h, flow, strict=True)]

    def _flow(self, dev: Values, shear: Any, limit: Any, f: Values) -> Values:
        """What a particle that yields adds to dev h: it goes straight back to the surface."""
        share = limit / shear - 1.0
        return [share * d for d in dev]

    def _unit(self, parameters: Parameters) -> Scalars:
        """The strain that tensile limit and cohesion are measured in."""
        if "yield_stress" in self.parameter_names:
            return strain_of_stress("yield_stress", parameters)
        return torch.full_like(parameters["youngs_modulus"], REFERENCE_YIELD_STRAIN)

    def _strain_for_stress(self, parameters: Parameters) -> Scalars:
        """Shear strain over volumetric strain where |dev tau| equals the pressure, K/(2 mu) [-]."""
        lam, mu = lame_constants(parameters)
        return (lam + 2.0 / 3.0 * mu) / (2.0 * mu)


def _zero(like: Any) -> Any:
    return torch.zeros_like(like) if isinstance(like, Tensor) else 0.0
