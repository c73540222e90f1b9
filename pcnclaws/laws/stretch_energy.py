"""Neural elasticity for measured stress, `model=pcnclaws_stretches`: a convex energy of the principal stretches.

It starts from no law: what the stiffness is at each stretch is learned, but that it is never negative. The sum over
the principal stretches is that of Valanis and Landel 1967, "The strain-energy function of a hyperelastic material in
terms of the extension ratios".
"""

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import torch
from jaxtyping import Float
from torch import Tensor, nn

from pcnclaws.laws.base import Elasticity, Values
from pcnclaws.laws.materials import Material
from pcnclaws.laws.moduli import lame_constants
from pcnclaws.laws.networks import ConditionalMLP
from pcnclaws.laws.operations import exp, maximum, minimum, softplus, tanh, trace
from pcnclaws.tensors.tensor_types import Parameters

# Numbers that tell apart how the stiffness of specimens changes with strain, beside their moduli and scale of strain.
SHAPES = 2
# Strains over the scale between which the energy is learned, before a training says where it was.
WIDEST = 3.0
# How much rarer, as logarithms, an untrained law holds functions that stiffen under compression, and bumps.
RARE_NEGATIVE, RARE_BUMPS = 2.0, 4.0


class StretchEnergyNet(Elasticity):
    """Isotropic elasticity with an energy that is convex in the principal Hencky strains.

        psi = 2 mu sum_i w(h_i) + lambda/4 (J^2 - 1 - 2 ln J)
        w(h) = scale^2 sum_k a_k f_k(h / scale),   a_k >= 0,   w''(0) = 1

    The f_k'' are exponentials e^(c x) and bumps 1/cosh^2((x - m)/width), none of them negative: stress grows with
    strain in every direction (Hill's inequality), nothing but rest is free of stress, and E and nu are the moduli at
    rest. A network gives the amounts a_k from the shape of the specimen; shape and scale are found in training. Beyond
    the reach of the training the stiffness stays what it is at its end.

    shape  of the specimen, (SHAPES, 1)
    scale  logarithm of its scale of strain, (1,)
    reach  least and largest h / scale that were trained on, (2,)
    """

    exponents: ClassVar[tuple[int, ...]] = (0, 1, 2, 4, -1, -2, -4)
    bumps: ClassVar[tuple[float, ...]] = tuple(0.25 * k for k in range(-8, 5))
    bump_width: ClassVar[float] = 0.25
    reach: Tensor

    def __init__(self, material: Material, width: int) -> None:
        super().__init__()
        self.parameter_names = material.elasticity.parameter_names
        self.amounts = ConditionalMLP(SHAPES, len(self.exponents) + len(self.bumps), width)
        self.shape, self.scale = nn.Parameter(torch.zeros(SHAPES, 1)), nn.Parameter(torch.zeros(1))
        self.register_buffer("reach", torch.tensor([-WIDEST, WIDEST]))

    def coefficients(self, parameters: Parameters) -> Mapping[str, Tensor]:
        lam, mu = lame_constants(parameters)
        scale, (low, high) = self.scale.to(mu.dtype).exp(), self.reach.to(mu.dtype).unbind()
        shares = self.shares(self.amounts(self.shape)).to(mu.dtype)
        stiffnesses = 2.0 * mu * shares / self.at_rest(shares)
        rows = dict(zip(self.names, stiffnesses.unbind(0), strict=True))
        return {"lam": lam, "scale": scale.expand_as(mu), "low": low.expand_as(mu), "high": high.expand_as(mu), **rows}

    @property
    def names(self) -> list[str]:
        """What the formulas call the stiffnesses 2 mu a_k [Pa]."""
        return [f"stiffness_{k}" for k in range(len(self.exponents) + len(self.bumps))]

    def shares(self, learned: Float[Tensor, "functions specimens"]) -> Float[Tensor, "functions specimens"]:
        """The amounts, but for a factor, from the outputs of the network: their sum is 1."""
        rare = [-RARE_NEGATIVE * max(-c, 0) - abs(c) for c in self.exponents] + [-RARE_BUMPS] * len(self.bumps)
        return torch.softmax(learned + learned.new_tensor(rare)[:, None], 0)

    def at_rest(self, shares: Float[Tensor, "functions specimens"]) -> Float[Tensor, " specimens"]:
        """sum_k a_k f_k''(0)."""
        ones = [1.0] * len(self.exponents)
        bumps = shares.new_tensor([centre / self.bump_width for centre in self.bumps]).cosh().square().reciprocal()
        return torch.cat((shares.new_tensor(ones), bumps)) @ shares

    def principal_stress(self, h: Values, p: Any) -> Values:
        volumetric = trace(h)
        pressure = 0.5 * p.lam * (exp(2.0 * volumetric) - 1.0)
        return [p.scale * self._sum(strain, p, "slope") + pressure for strain in h]

    def principal_energy(self, h: Values, p: Any) -> Any:
        volumetric = trace(h)
        of_strains = sum(self._sum(strain, p, "energy") for strain in h)
        return p.scale * p.scale * of_strains + 0.25 * p.lam * (exp(2.0 * volumetric) - 1.0 - 2.0 * volumetric)

    def each(self, x: Any, p: Any, what: str) -> list[Any]:
        """All f_k(x), or their slopes, or their curvatures: the second derivatives.

        x     principal strains over the scale
        what  energy, slope or curvature
        """
        at = _Strain(x, p, self.bump_width)
        exponentials = [getattr(at, f"exponential_{what}")(exponent) for exponent in self.exponents]
        bumps = [getattr(at, f"bump_{what}")(centre / self.bump_width) for centre in self.bumps]
        return [*exponentials, *bumps]

    def _sum(self, strain: Any, p: Any, what: str) -> Any:
        """sum_k 2 mu a_k f_k(x), or of their slopes."""
        each = self.each(strain / p.scale, p, what)
        return sum(getattr(p, name) * one for name, one in zip(self.names, each, strict=True))


class _Strain:
    """A principal strain over the scale, x; functions of it go on with a constant second derivative beyond the reach.

    One exponential and one hyperbolic tangent make all of them: powers of e^x, and tanh(a - b) from tanh(a).
    """

    def __init__(self, x: Any, p: Any, width: float) -> None:
        self.width = width
        self.within = minimum(maximum(x, p.low), p.high)
        self.beyond = x - self.within
        power = exp(self.within)
        self._powers = {1: power, -1: 1.0 / power}
        self._bent = tanh(self.within / width)

    def exponential_slope(self, c: int) -> Any:
        """(e^(c x) - 1)/c, and x for c = 0."""
        if c == 0:
            return self.within + self.beyond
        power = self._power(c)
        return (power - 1.0) / c + power * self.beyond

    def exponential_energy(self, c: int) -> Any:
        """Its integral from 0."""
        if c == 0:
            return 0.5 * (self.within + self.beyond) ** 2
        power = self._power(c)
        return (power - 1.0 - c * self.within) / c**2 + self.beyond * ((power - 1.0) / c + 0.5 * power * self.beyond)

    def exponential_curvature(self, c: int) -> Any:
        """e^(c x)."""
        return self._power(c) if c else self._power(1) * self._power(-1)

    def bump_slope(self, m: float) -> Any:
        """The integral of 1/cosh^2(x/width - m) from 0."""
        return self.width * (self._bent_about(m) + math.tanh(m)) + self.bump_curvature(m) * self.beyond

    def bump_curvature(self, m: float) -> Any:
        """1/cosh^2(x/width - m)."""
        bent = self._bent_about(m)
        return 1.0 - bent * bent

    def bump_energy(self, m: float) -> Any:
        """Its integral from 0."""
        width = self.width
        within = width * width * (_log_cosh(self.within / width - m) - math.log(math.cosh(m)))
        slope, curvature = width * (self._bent_about(m) + math.tanh(m)), self.bump_curvature(m)
        return within + width * math.tanh(m) * self.within + self.beyond * (slope + 0.5 * curvature * self.beyond)

    def _power(self, c: int) -> Any:
        """e^(c x) of a power of two, c, or of its negative."""
        if c not in self._powers:
            half = self._power(c // 2)
            self._powers[c] = half * half
        return self._powers[c]

    def _bent_about(self, m: float) -> Any:
        """tanh(x/width - m)."""
        return (self._bent - math.tanh(m)) / (1.0 - self._bent * math.tanh(m))


def _log_cosh(x: Any) -> Any:
    return x + softplus(-2.0 * x) - math.log(2.0)
