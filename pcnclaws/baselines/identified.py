"""System identification: the analytic laws with unknown physical parameters, which training finds by gradient.

The ceiling of what a learner of one object can reach: the form of the law is given, a few numbers are not.
"""

import math
from collections.abc import Mapping, Sequence

import torch
from torch import Tensor, nn

from pcnclaws.laws.analytic import Laws
from pcnclaws.laws.base import Elasticity, Plasticity
from pcnclaws.laws.materials import Material
from pcnclaws.laws.parameters import PARAMETERS
from pcnclaws.tensors.tensor_types import Matrices, Parameters


class UnknownParameters(nn.Module):
    """Physical parameters as trainable numbers without bounds, each 0 at the first guess.

    A parameter of an unbounded range is guess * exp(x), one between two bounds is lower + (upper - lower) / (1 +
    exp(-x - x_guess)): no step of the optimiser leaves what physics allows.

    guess  first guess by name, in the units of PARAMETERS
    """

    def __init__(self, guess: Mapping[str, float]) -> None:
        super().__init__()
        self.guess = dict(guess)
        self.unbounded = nn.ParameterDict({name: nn.Parameter(torch.zeros(())) for name in self.guess})

    def forward(self) -> dict[str, Tensor]:
        """The parameters by name, each without a dimension."""
        return {name: _bounded(name, guess, self.unbounded[name]) for name, guess in self.guess.items()}

    def values(self) -> dict[str, float]:
        """The parameters as plain numbers."""
        return {name: float(value.detach()) for name, value in self().items()}


class IdentifiedElasticity(Elasticity):
    """The analytic elasticity of a material with the identified parameters in the place of the given ones."""

    def __init__(self, material: Material, unknown: UnknownParameters) -> None:
        super().__init__()
        self.law, self.unknown = material.elasticity(), unknown
        self.parameter_names = self.law.parameter_names

    def kirchhoff_stress(self, deformation: Matrices, parameters: Parameters) -> Matrices:
        return self.law(deformation, _per_particle(self.unknown, self.parameter_names, deformation))


class IdentifiedPlasticity(Plasticity):
    """The analytic plasticity of a material with the identified parameters in the place of the given ones."""

    def __init__(self, material: Material, unknown: UnknownParameters) -> None:
        super().__init__()
        if material.plasticity is None:
            raise ValueError(f"material '{material.name}' is purely elastic and has no plastic law")
        self.law, self.unknown = material.plasticity(), unknown
        self.parameter_names = self.law.parameter_names

    def return_map(self, trial: Matrices, parameters: Parameters) -> Matrices:
        return self.law(trial, _per_particle(self.unknown, self.parameter_names, trial))


def identified(material: Material) -> Laws:
    """The analytic laws of a material with parameters that are sought from the middle of their ranges."""
    unknown = UnknownParameters(material.defaults)
    plasticity = IdentifiedPlasticity(material, unknown) if material.plasticity else None
    return Laws(IdentifiedElasticity(material, unknown), plasticity)


def identified_values(laws: Laws) -> dict[str, float]:
    """The identified parameters of such laws; none of others."""
    return laws.elasticity.unknown.values() if isinstance(laws.elasticity, IdentifiedElasticity) else {}


def _per_particle(unknown: UnknownParameters, names: Sequence[str], like: Matrices) -> dict[str, Tensor]:
    values = unknown()
    return {name: values[name].to(like.dtype).expand(like.shape[-1]) for name in names}


def _bounded(name: str, guess: float, x: Tensor) -> Tensor:
    parameter = PARAMETERS[name]
    lower, upper = parameter.plausible[0] if parameter.plausible else parameter.lower, parameter.upper
    if math.isinf(upper):
        return guess * torch.exp(x)
    share = (guess - lower) / (upper - lower)
    return lower + (upper - lower) * torch.sigmoid(x + math.log(share / (1.0 - share)))
