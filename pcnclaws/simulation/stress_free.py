"""Stress-free reference state: whether a law leaves an undeformed body alone, so that free fall needs no law."""

import math

import torch
from torch import Tensor
from torch.autograd import forward_ad

from pcnclaws.laws.internal_variables import start_values
from pcnclaws.simulation.simulator import Simulator
from pcnclaws.tensors.tensor_types import Parameters

# Stress (divided by E) and strain that count as none, in units of machine precision.
ROUNDING = 64.0


def is_stress_free_at_rest(simulator: Simulator, parameters: Parameters) -> bool:
    """Whether F = I gives no stress and no flow, and would with weights and parameters a little different.

    Neither strain nor internal variables flow.

    The analytic laws and our neural ones do by their structure.
    """
    parameters = simulator.law_parameters(parameters)
    any_parameter = next(iter(parameters.values()))
    identity = torch.eye(3, dtype=any_parameter.dtype, device=any_parameter.device)[:, :, None]
    identity = identity.repeat(1, 1, len(any_parameter))
    stiffness = parameters["youngs_modulus"].detach() if "youngs_modulus" in parameters else 1.0
    responses = [simulator.elasticity(identity, parameters) / stiffness]
    if simulator.plasticity is not None:
        flown, internal = simulator.plasticity.answer(identity, parameters)
        responses.append(flown - identity)
        if internal is not None:
            responses.append(internal - start_values(simulator.plasticity.internal_variables, identity))
    if simulator.viscosity is not None:
        responses.append(simulator.viscosity(torch.zeros_like(identity), parameters) / stiffness)

    response = torch.cat([one.flatten(end_dim=-2) for one in responses])
    inputs = [tensor for tensor in (*simulator.parameters(), *parameters.values()) if tensor.requires_grad]
    eps = torch.finfo(response.dtype).eps
    still = bool((response.detach().abs() <= ROUNDING * eps).all())  # false for what is not a number
    return still and _largest_derivative(response, inputs) <= math.sqrt(eps)


def _largest_derivative(response: Tensor, inputs: list[Tensor]) -> float:
    """Largest change of the response with a change of an input by its own size (by 1 where that is less than 1)."""
    tangent = forward_ad.unpack_dual(response).tangent
    largest = 0.0 if tangent is None else float(tangent.abs().max())
    if not response.requires_grad or not inputs:
        return largest
    # different factors, so that the nine components cannot cancel
    factors = torch.linspace(1.0, 2.0, response.numel(), dtype=response.dtype, device=response.device)
    total = (response.flatten() * factors).sum()
    for gradient, value in zip(torch.autograd.grad(total, inputs, allow_unused=True), inputs, strict=True):
        if gradient is not None:
            largest = max(largest, float((gradient * value.detach().abs().clamp_min(1.0)).abs().max()))
    return largest
