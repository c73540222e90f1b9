"""The neural laws of the unified material, `model=pcnclaws_unified`: one pair of networks for all of its kinds.

Both networks see the shares of the kinds as further conditions, and parameters that a kind does not read times its
share, so that they change nothing. What the networks say is in parts, one for each kind, which are mixed by the shares:
the kind is a factor of the last layer, too. Everything else is the default variant's (neural_default.py).
"""

from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from pcnclaws.errors import UserError
from pcnclaws.laws.base import Values
from pcnclaws.laws.materials import Material
from pcnclaws.laws.networks import ConditionalMLP, DimensionlessParameters, strain_of_stress
from pcnclaws.laws.neural_default import REFERENCE_YIELD_STRAIN, ElasticNet, PlasticNet
from pcnclaws.laws.parameters import FRICTION_ANGLE, PLASTICINE_SHARE, SAND_SHARE, YIELD_STRESS
from pcnclaws.laws.unified import mixed_flow, shares
from pcnclaws.tensors.tensor_types import Parameters

# Whose parameters they are: of no account where the kind has no share.
OF_KIND = {YIELD_STRESS.name: PLASTICINE_SHARE.name, FRICTION_ANGLE.name: SAND_SHARE.name}
KINDS = ("elasticity", "plasticine", "sand")


class KindParameters(DimensionlessParameters):
    """The dimensionless parameters, each times the share of the kind that reads it, and the shares."""

    def forward(self, parameters: Parameters) -> Float[Tensor, "inputs particles"]:
        known = {**parameters, **_shares_by_name(parameters)}
        rows = super().forward(known)
        read = [known[OF_KIND[name]] if name in OF_KIND else torch.ones_like(rows[0]) for name in self.names]
        return rows * torch.stack(read)


class UnifiedElasticNet(ElasticNet):
    """The default elasticity, whose factors are the means of those that the network says of each kind."""

    factors = 6  # of the default elasticity

    def __init__(self, material: Material, width: int) -> None:
        _require_shares(material)
        super().__init__(material, width)
        self.condition = KindParameters(material.ranges, self.parameter_names)
        self.network = ConditionalMLP(3 + self.condition.count, len(KINDS) * self.factors, width)

    def coefficients(self, parameters: Parameters) -> Mapping[str, Tensor]:
        plasticine, sand = shares(parameters)
        return {
            **super().coefficients(parameters),
            "elasticity": 1.0 - plasticine - sand,
            "plasticine": plasticine,
            "sand": sand,
        }

    def respond(self, h: Values, p: Any, x: Values, f: Values) -> Values:
        own = [
            sum(getattr(p, kind) * f[part * self.factors + k] for part, kind in enumerate(KINDS))
            for k in range(self.factors)
        ]
        return super().respond(h, p, x, own)


class UnifiedPlasticNet(PlasticNet):
    """The default return of plasticine and that of sand, each by its share: h' = h + p (h'_p - h) + s (h'_s - h).

    An elastic body does not yield, whatever the weights are. Limits of plasticine are measured in yield strains, those
    of sand in a constant one.
    """

    conditioning = KindParameters
    limits = 3  # tensile limit, cohesion and friction of each kind that flows
    outputs = 2 * limits

    def __init__(self, material: Material, width: int) -> None:
        _require_shares(material)
        super().__init__(material, width)

    def coefficients(self, parameters: Parameters) -> Mapping[str, Tensor]:
        plasticine, sand = shares(parameters)
        return {
            "unit_of_plasticine": strain_of_stress(YIELD_STRESS.name, parameters),
            "unit_of_sand": torch.full_like(plasticine, REFERENCE_YIELD_STRAIN),
            "strain_for_stress": self._strain_for_stress(parameters),
            "plasticine": plasticine,
            "sand": sand,
        }

    def respond(self, h: Values, p: Any, x: Values, f: Values) -> Values:
        units = (p.unit_of_plasticine, p.unit_of_sand)
        returned = [
            super(UnifiedPlasticNet, self).respond(
                h, SimpleNamespace(unit=unit, strain_for_stress=p.strain_for_stress), x, self._of_part(f, part)
            )
            for part, unit in enumerate(units)
        ]
        return mixed_flow(h, *zip((p.plasticine, p.sand), returned, strict=True))

    def _of_part(self, f: Values, part: int) -> Values:
        return [f[part * self.limits + k] for k in range(self.limits)]


def _shares_by_name(parameters: Parameters) -> dict[str, Tensor]:
    return dict(zip((PLASTICINE_SHARE.name, SAND_SHARE.name), shares(parameters), strict=True))


def _require_shares(material: Material) -> None:
    names: Sequence[str] = (PLASTICINE_SHARE.name, SAND_SHARE.name)
    if not all(name in law.parameter_names for law in (material.elasticity, material.plasticity) for name in names):
        raise UserError(
            f"model=pcnclaws_unified is not possible for the material '{material.name}', which has no "
            f"{' and '.join(names)}; accepted: material=unified"
        )
