"""Neural plasticity with a convex elastic domain of any shape, `model=pcnclaws_convex`: corners, flat sides and a cap.

The yield surface is a sum of convex functions of the deviator (yield_gauges.py), as in input-convex networks (Amos et
al. 2017, "Input convex neural networks"); their shares, and all limits, are polynomials of the physical parameters:
once a rollout, not once a step. The strain itself does not change them, so that what is on the surface stays there.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor

from pcnclaws.laws.base import Plasticity, Values
from pcnclaws.laws.materials import Material
from pcnclaws.laws.moduli import lame_constants
from pcnclaws.laws.networks import ConditionedAmounts, DimensionlessParameters, strain_of_stress
from pcnclaws.laws.neural_default import REFERENCE_YIELD_STRAIN
from pcnclaws.laws.operations import deviator, maximum, minimum, trace, where
from pcnclaws.laws.yield_gauges import GAUGES, returned
from pcnclaws.tensors.tensor_types import Parameters

# What the amounts are multiplied with: at the learning rates of the other networks they then move as far.
REACH = 8.0
# Compression tr h that an untrained law bears: more than any body meets. A bound that trained bodies come to without
# need stays within the reach of others.
UNTRAINED_COMPRESSION = 10.0
# What a training tries beside: a bound that nothing reaches has no gradient.
OTHER_COMPRESSIONS = (0.1, 0.03, 0.01)
LIMITS = ("tension", "compression", "cohesion", "friction")
_COMPRESSION = LIMITS.index("compression")
# Square roots of the shares of the gauges, of any sum, of an untrained law: half round, and nothing that is not there.
UNTRAINED_SHARES = (0.5, 0.5, 1.0, 0.5, 0.5)


class ConvexPlasticNet(Plasticity):
    """A return to a convex surface in pressure and in all of the deviator, whose limits and corners are learned.

        tr h' = min(max(tr h, -d), t, c/k'),   G(dev h') = min(G(dev h), c - k' tr h'),   k' = k K/(2 mu)

    t, d, c, k  limits of tension and of compression, cohesion, friction: at least 0; c/k' is the tip of the cone
    G           sum of convex functions, equal to |dev h| in pure shear (yield_gauges.GAUGES)

    The shear flow is radial, or along the normal of the surface, or between: one more number says how much. It changes
    no volume. F' = exp(h' - h) F; K/(2 mu) makes k a ratio of stresses. Inside the surface F' = F to the last bit, a
    second return changes nothing, and as |dev h| and |tr h| can only shrink, the Hencky energy can only be released.
    """

    def __init__(self, material: Material, width: int) -> None:
        super().__init__()
        if material.plasticity is None:
            raise ValueError(f"material '{material.name}' is purely elastic and has no plastic law")
        self.parameter_names = material.plasticity.parameter_names
        condition = DimensionlessParameters(material.ranges, self.parameter_names)
        self.amounts = ConditionedAmounts(condition, len(LIMITS) + len(GAUGES) + 1)

    def coefficients(self, parameters: Parameters) -> Mapping[str, Tensor]:
        lam, mu = lame_constants(parameters)
        amounts = REACH * self.amounts(parameters).to(mu.dtype)
        tension, compression, cohesion, friction = amounts[: len(LIMITS)]
        has_strength = "yield_stress" in self.parameter_names
        unit = strain_of_stress("yield_stress", parameters) if has_strength else REFERENCE_YIELD_STRAIN
        # squares reach 0, where the logarithm of a limit would have to travel for ever; what has a strength of its own
        # is taken to bear tension, and to owe little to pressure, until a training says otherwise
        first_tension, first_friction = (2.0, 0.2) if has_strength else (1.0, 0.5)
        start = torch.tensor(UNTRAINED_SHARES, dtype=mu.dtype, device=mu.device)[:, None]
        shares = (start + amounts[len(LIMITS) : -1]).square()
        shares = shares / shares.sum(0)
        return {
            "tension": unit * (first_tension + tension).square(),
            "compression": UNTRAINED_COMPRESSION * compression.exp(),
            "cohesion": unit * (1.0 + cohesion).square(),
            "friction": (lam + 2.0 / 3.0 * mu) / (2.0 * mu) * (first_friction + friction).square(),
            # between 0 and 1, both of which it reaches
            "normal": (0.25 * math.pi + amounts[-1]).sin().square(),
            **dict(zip(GAUGES, shares, strict=True)),
        }

    def alternatives(self) -> list[Tensor]:
        """The weights of the amounts with other bounds on compression, the same for all parameters."""
        found = []
        for compression in (UNTRAINED_COMPRESSION, *OTHER_COMPRESSIONS):
            other = self.amounts.weight.detach().clone()
            other[_COMPRESSION] = 0.0
            other[_COMPRESSION, 0] = math.log(compression / UNTRAINED_COMPRESSION) / REACH
            found.append(other)
        return found

    def respond(self, h: Values, p: Any, x: Values, f: Values) -> Values:
        dev, volumetric = deviator(h), trace(h)
        tension = minimum(volumetric, p.tension)
        beyond = p.friction * tension > p.cohesion  # the tip of the cone
        after = maximum(where(beyond, p.cohesion / where(beyond, p.friction, 1.0), tension), -p.compression)
        limit = maximum(p.cohesion - p.friction * after, 0.0 * after)
        flows, there = returned(dev, limit, self._shares(p), p.normal)
        mean = (after - volumetric) / 3.0
        return [s + (where(flows, new - d, 0.0) + mean) for s, new, d in zip(h, there, dev, strict=True)]

    def _shares(self, p: Any) -> Sequence[Any]:
        return [getattr(p, name) for name in GAUGES]
