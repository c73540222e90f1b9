"""Isotropic laws as kernels, differentiable in both modes, on a GPU in reverse mode alone.

A law is a function of principal strains (law_source.py); its derivatives follow from it by dual numbers and a tape.
"""

import ctypes
from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from pcnclaws.compiled import build, gpu
from pcnclaws.compiled.build import law_library
from pcnclaws.compiled.calls import (
    address,
    addresses,
    call,
    carries_rates,
    derivatives_wanted,
    require_first_derivative,
)
from pcnclaws.compiled.law_source import LawKernel
from pcnclaws.compiled.structures import LawInput, weights_structure


def isotropic_law(
    law: LawKernel, deformation: Tensor, parameters: Tensor, weights: Sequence[Tensor] = (), evaluated: bool = True
) -> Tensor:
    """Kirchhoff stress [Pa] or elastic deformation gradient [-] of a law, (3, 3, particles).

    deformation  F [-], (3, 3, particles), det F > 0
    parameters   that the law's response reads, then further inputs of its network, (rows, particles)
    weights      of its network: matrices (to, from), then biases (to, 1)
    evaluated    False for a result that is differentiated but not looked at: its numbers have no meaning
    """
    tensors = (deformation, parameters, *weights)
    if not derivatives_wanted():
        return _evaluated(law, *(tensor.contiguous() for tensor in tensors))
    return _Law.apply(law, carries_rates(tensors) or not evaluated, *tensors)


def law_serves(law: LawKernel, state: Tensor) -> bool:
    """Whether the law's kernel computes on the device of the state, where kernels_serve.

    On a GPU networks have two hidden layers: each thread keeps one of them.
    """
    return law.layers == gpu.LAYERS if state.is_cuda else law_library(law.text) is not None


def fallbacks() -> int:
    """How many particles found their principal axes by the slow path of source/graded_axes.hpp in this process.

    Stretches from 0.01 to 100 do without. Waits for GPUs that laws ran on.
    """
    return build.fallbacks() + gpu.fallbacks()


def _evaluated(law: LawKernel, deformation: Tensor, parameters: Tensor, *weights: Tensor) -> Tensor:
    if deformation.is_cuda:
        return gpu.law_forward(law, deformation, parameters, weights)
    result = torch.empty_like(deformation)
    law_input, _kept = _described(law, deformation, parameters, weights)
    call(law_library(law.text), "law_forward", deformation.dtype, ctypes.byref(law_input), address(result))
    return result


def _described(
    law: LawKernel, deformation: Tensor, parameters: Tensor, weights: Sequence[Tensor]
) -> tuple[LawInput, Any]:
    """The kernel's input, and what must stay alive while it runs."""
    network = weights_structure(law.layers, weights) if weights else None
    pointer = ctypes.cast(ctypes.pointer(network), ctypes.c_void_p) if network is not None else None
    particles = deformation.shape[2]
    rows = parameters.shape[0]
    arrays = deformation.data_ptr(), parameters.data_ptr()
    return LawInput(particles, *arrays, rows, pointer), network


class _Law(torch.autograd.Function):
    """later: the result is not computed. Where rates are, jvp, which PyTorch calls next, fills it in."""

    @staticmethod
    def forward(ctx: Any, law: LawKernel, later: bool, *tensors: Tensor) -> Tensor:
        deformation, parameters, *weights = (tensor.contiguous() for tensor in tensors)
        result = torch.empty_like(deformation) if later else _evaluated(law, deformation, parameters, *weights)
        ctx.law, ctx.result = law, result.detach() if later else None
        ctx.save_for_backward(deformation, parameters, *weights)
        ctx.save_for_forward(deformation, parameters, *weights)
        return result

    @staticmethod
    def backward(  # pyright: ignore[reportIncompatibleMethodOverride]
        ctx: Any, incoming: Tensor
    ) -> tuple[Tensor | None, ...]:
        require_first_derivative()
        deformation, parameters, *weights = ctx.saved_tensors
        incoming, none = incoming.contiguous(), [None] * len(weights)
        wanted = ctx.needs_input_grad[3], any(ctx.needs_input_grad[4:])
        if deformation.is_cuda:
            found = gpu.law_adjoint(ctx.law, deformation, parameters, weights, incoming, wanted)
            return (None, None, found.deformation, found.parameters, *(found.weights or none))
        gradient = torch.empty_like(deformation)
        of_parameters = torch.empty_like(parameters) if wanted[0] else None
        of_weights = [torch.empty_like(weight) for weight in weights] if wanted[1] else []
        law_input, _kept = _described(ctx.law, deformation, parameters, weights)
        call(
            law_library(ctx.law.text),
            "law_adjoint",
            deformation.dtype,
            ctypes.byref(law_input),
            address(incoming),
            address(gradient),
            address(of_parameters),
            addresses(*of_weights) if of_weights else None,
        )
        return (None, None, gradient, of_parameters, *(of_weights or none))

    @staticmethod
    def jvp(ctx: Any, *rates: Tensor | None) -> Tensor:  # pyright: ignore[reportIncompatibleMethodOverride]
        deformation, parameters, *weights = ctx.saved_tensors
        of_deformation, of_parameters = (
            torch.zeros_like(field) if rate is None else rate.contiguous()
            for field, rate in zip((deformation, parameters), rates[2:4], strict=True)
        )
        result_rate = torch.empty_like(deformation)
        law_input, _kept = _described(ctx.law, deformation, parameters, weights)
        call(
            law_library(ctx.law.text),
            "law_rates",
            deformation.dtype,
            ctypes.byref(law_input),
            address(of_deformation),
            address(of_parameters),
            address(ctx.result),
            address(result_rate),
        )
        return result_rate
