"""The multilayer perceptron of the neural laws, component-first, and what it is conditioned on."""

import math
from collections.abc import Mapping
from itertools import pairwise

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from pcnclaws.laws.moduli import lame_constants
from pcnclaws.laws.parameters import PARAMETERS
from pcnclaws.tensors.tensor_types import Parameters


class ConditionalMLP(nn.Module):
    """Linear layers with GELU between them, (inputs, particles) -> (outputs, particles).

    The last layer starts at zero, so that an untrained law is exactly the structure around the network.
    """

    def __init__(self, inputs: int, outputs: int, width: int, zero_start: bool = True, hidden_layers: int = 2) -> None:
        super().__init__()
        sizes = (inputs, *(width for _ in range(hidden_layers)), outputs)
        self.inputs, self.outputs, self.layers = inputs, outputs, hidden_layers + 1
        self.weights = nn.ParameterList(torch.empty(b, a) for a, b in pairwise(sizes))
        self.biases = nn.ParameterList(torch.zeros(b, 1) for b in sizes[1:])
        for weight in self.weights:
            nn.init.xavier_uniform_(weight)
        if zero_start:
            nn.init.zeros_(self.weights[-1])

    @property
    def all_weights(self) -> tuple[Tensor, ...]:
        """The matrices of the layers, then their biases."""
        # not item by item, which takes as long as a small kernel
        return (*self.weights.parameters(recurse=False), *self.biases.parameters(recurse=False))

    def forward(self, x: Float[Tensor, "inputs particles"]) -> Float[Tensor, "outputs particles"]:
        *hidden, (last_weight, last_bias) = zip(self.weights, self.biases, strict=True)
        for weight, bias in hidden:
            x = functional.gelu(torch.addmm(bias, weight, x))
        return torch.addmm(last_bias, last_weight, x)


class StandardisedParameters(nn.Module):
    """Physical parameters as inputs of a network: scaled to [-1, 1] over the ranges of the material, one row each."""

    centre: Tensor
    half_width: Tensor

    def __init__(self, ranges: Mapping[str, tuple[float, float]], names: tuple[str, ...]) -> None:
        super().__init__()
        self.names = names
        limits = torch.tensor([ranges[name] for name in names], dtype=torch.float32)
        self.register_buffer("centre", limits.mean(1, keepdim=True), persistent=False)
        self.register_buffer("half_width", (limits[:, 1:] - limits[:, :1]) / 2.0, persistent=False)

    @property
    def count(self) -> int:
        return len(self.names)

    def forward(self, parameters: Parameters) -> Float[Tensor, "inputs particles"]:
        return (torch.stack([self._value(name, parameters) for name in self.names]) - self.centre) / self.half_width

    def _value(self, name: str, parameters: Parameters) -> Float[Tensor, " particles"]:
        return parameters[name]


class DimensionlessParameters(StandardisedParameters):
    """The physical parameters as inputs of a network: dimensionless and of order one.

    A law divided by its moduli can depend on them only through dimensionless numbers: Poisson's ratio, the friction
    angle, and stresses such as tau_Y as the strains tau_Y/(2 mu), which enter as logarithms. Young's modulus alone does
    not enter, so that a law holds for every stiffness. Standardised by the ranges of the material.
    """

    def __init__(self, ranges: Mapping[str, tuple[float, float]], names: tuple[str, ...]) -> None:
        own = {name: _strain_range(name, ranges) if PARAMETERS[name].is_stress else ranges[name] for name in names}
        super().__init__(own, tuple(name for name in names if name != "youngs_modulus"))

    def _value(self, name: str, parameters: Parameters) -> Float[Tensor, " particles"]:
        return torch.log(strain_of_stress(name, parameters)) if PARAMETERS[name].is_stress else parameters[name]


class ConditionedAmounts(nn.Module):
    """Polynomials of physical parameters, (outputs, particles): linear in the weights, zero untrained.

        amount_i = weight_i0 + sum_j (weight_ij t_j + weight'_ij t_j^2)

    condition  gives the t_j from the parameters
    """

    def __init__(self, condition: StandardisedParameters, outputs: int) -> None:
        super().__init__()
        self.condition = condition
        self.weight = nn.Parameter(torch.zeros(outputs, 1 + 2 * condition.count))

    def features(self, parameters: Parameters) -> Float[Tensor, "features particles"]:
        """What the weights are the coefficients of: 1, t_j, t_j^2."""
        one = torch.ones_like(next(iter(parameters.values())))[None]
        known = self.condition(parameters) if self.condition.count else one[:0]
        return torch.cat((one, known, known.square()))

    def forward(self, parameters: Parameters) -> Float[Tensor, "outputs particles"]:
        return self.weight @ self.features(parameters).to(self.weight.dtype)


def strain_of_stress(name: str, parameters: Parameters) -> Float[Tensor, " particles"]:
    """Shear strain |dev h| at which a stress such as the yield stress is reached, tau_Y/(2 mu) [-]; at least 1e-6."""
    _, mu = lame_constants(parameters)
    return (parameters[name] / (2.0 * mu)).clamp_min(1e-6)


def _strain_range(name: str, ranges: Mapping[str, tuple[float, float]]) -> tuple[float, float]:
    """Logarithms of the smallest and the largest such strain in the ranges of a material."""
    (e_low, e_high), (nu_low, nu_high) = ranges["youngs_modulus"], ranges["poissons_ratio"]
    low, high = ranges[name]
    return math.log(low * (1.0 + nu_low) / e_high), math.log(high * (1.0 + nu_high) / e_low)
