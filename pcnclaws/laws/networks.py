"""The multilayer perceptron of the neural laws, component-first, and what it is conditioned on."""

import math
from collections.abc import Mapping
from itertools import pairwise

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from pcnclaws.laws.parameters import lame_constants
from pcnclaws.tensor_types import Parameters


class ConditionalMLP(nn.Module):
    """Three linear layers with GELU between them, (inputs, particles) -> (outputs, particles).

    The last layer starts at zero, so that an untrained law is exactly the structure around the network.
    """

    def __init__(self, inputs: int, outputs: int, width: int, zero_start: bool = True) -> None:
        super().__init__()
        sizes = (inputs, width, width, outputs)
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

    A law divided by its moduli can depend on them only through dimensionless numbers: Poisson's ratio, the
    friction angle and the yield strain tau_Y/(2 mu), which enters as a logarithm. Young's modulus alone does not
    enter, so that a law holds for every stiffness. Standardised by the ranges of the material.
    """

    def __init__(self, ranges: Mapping[str, tuple[float, float]], names: tuple[str, ...]) -> None:
        own = dict(ranges)
        if "yield_stress" in own:
            own["yield_stress"] = _yield_strain_range(ranges)
        super().__init__(own, tuple(name for name in names if name != "youngs_modulus"))

    def _value(self, name: str, parameters: Parameters) -> Float[Tensor, " particles"]:
        return torch.log(yield_strain(parameters)) if name == "yield_stress" else parameters[name]


def yield_strain(parameters: Parameters) -> Float[Tensor, " particles"]:
    """Shear strain |dev h| at which the yield stress is reached, tau_Y/(2 mu) [-]; at least 1e-6."""
    _, mu = lame_constants(parameters)
    return (parameters["yield_stress"] / (2.0 * mu)).clamp_min(1e-6)


def _yield_strain_range(ranges: Mapping[str, tuple[float, float]]) -> tuple[float, float]:
    """Logarithms of the smallest and the largest yield strain in the ranges of a material."""
    (e_low, e_high), (nu_low, nu_high) = ranges["youngs_modulus"], ranges["poissons_ratio"]
    low, high = ranges["yield_stress"]
    return math.log(low * (1.0 + nu_low) / e_high), math.log(high * (1.0 + nu_high) / e_low)
