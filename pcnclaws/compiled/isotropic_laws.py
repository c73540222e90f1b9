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
from pcnclaws.compiled.structures import LawArrays, LawFields, LawInput, weights_structure
from pcnclaws.guards import counts_elsewhere


def isotropic_law(law: LawKernel, given: LawArrays, evaluated: bool = True) -> tuple[Tensor, Tensor | None]:
    """Kirchhoff stress [Pa] or elastic deformation gradient [-] of a law, (3, 3, particles).

    evaluated  False for a result that is differentiated but not looked at: its numbers have no meaning
    returns    it, and the internal variables after plastic flow, None where the law changes none
    """
    deformation, parameters, internal, weights = given
    tensors = (deformation, parameters, internal, *weights)
    if not derivatives_wanted():
        return _evaluated(law, _contiguous(tensors))
    later = carries_rates([tensor for tensor in tensors if tensor is not None]) or not evaluated
    result = _Law.apply(law, later, *tensors)
    return result if law.after else (result, None)


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


counts_elsewhere("principal_axes_by_the_slow_path", fallbacks)


def _contiguous(tensors: Sequence[Tensor | None]) -> LawArrays:
    deformation, parameters, internal, *weights = (None if one is None else one.contiguous() for one in tensors)
    return LawArrays(deformation, parameters, internal, weights)  # pyright: ignore[reportArgumentType]  # one is None


def _saved(ctx: Any) -> LawArrays:
    deformation, parameters, internal, *weights = ctx.saved_tensors
    return LawArrays(deformation, parameters, internal, weights)


def _evaluated(law: LawKernel, given: LawArrays) -> tuple[Tensor, Tensor | None]:
    if given.deformation.is_cuda:
        return gpu.law_forward(law, given)
    result = given.like_result(law.after)
    law_input, _kept = _described(law, given)
    dtype, fields = given.deformation.dtype, LawFields.of(*result)
    call(law_library(law.text), "law_forward", dtype, ctypes.byref(law_input), ctypes.byref(fields))
    return result


def _described(law: LawKernel, given: LawArrays) -> tuple[LawInput, Any]:
    """The kernel's input, and what must stay alive while it runs."""
    deformation, parameters, internal, weights = given
    if (0 if internal is None else len(internal)) != law.internal:
        raise ValueError(f"the law '{law.name}' reads {law.internal} internal variables")
    network = weights_structure(law.layers, weights) if weights else None
    pointer = ctypes.cast(ctypes.pointer(network), ctypes.c_void_p) if network is not None else None
    arrays = deformation.data_ptr(), parameters.data_ptr()
    remembered = internal.data_ptr() if internal is not None else None
    return LawInput(deformation.shape[2], *arrays, parameters.shape[0], pointer, remembered), network


class _Law(torch.autograd.Function):
    """later: the result is not computed. Where rates are, jvp, which PyTorch calls next, fills it in."""

    @staticmethod
    def forward(ctx: Any, law: LawKernel, later: bool, *tensors: Tensor | None) -> Any:
        given = _contiguous(tensors)
        result = given.like_result(law.after) if later else _evaluated(law, given)
        ctx.law, ctx.result = law, tuple(None if one is None else one.detach() for one in result) if later else None
        saved = given[:3] + tuple(given.weights)
        ctx.save_for_backward(*saved)
        ctx.save_for_forward(*saved)
        return result if law.after else result[0]

    @staticmethod
    def backward(  # pyright: ignore[reportIncompatibleMethodOverride]
        ctx: Any, *incoming: Tensor
    ) -> tuple[Tensor | None, ...]:
        require_first_derivative()
        given = _saved(ctx)
        law, none = ctx.law, [None] * len(given.weights)
        of_result = incoming[0].contiguous(), incoming[1].contiguous() if law.after else None
        wanted = ctx.needs_input_grad[3], any(ctx.needs_input_grad[5:])
        if given.deformation.is_cuda:
            found = gpu.law_adjoint(law, given, of_result, wanted)
            return (None, None, found.deformation, found.parameters, found.internal, *(found.weights or none))
        gradient = given.like_result(law.internal)
        of_parameters = torch.empty_like(given.parameters) if wanted[0] else None
        of_weights = [torch.empty_like(weight) for weight in given.weights] if wanted[1] else []
        law_input, _kept = _described(law, given)
        call(
            law_library(law.text),
            "law_adjoint",
            given.deformation.dtype,
            ctypes.byref(law_input),
            ctypes.byref(LawFields.of(*of_result)),
            ctypes.byref(LawFields.of(*gradient)),
            address(of_parameters),
            addresses(*of_weights) if of_weights else None,
        )
        return (None, None, gradient[0], of_parameters, gradient[1], *(of_weights or none))

    @staticmethod
    def jvp(ctx: Any, *rates: Tensor | None) -> Any:  # pyright: ignore[reportIncompatibleMethodOverride]
        given = _saved(ctx)
        of_deformation, of_parameters = (
            torch.zeros_like(field) if rate is None else rate.contiguous()
            for field, rate in zip(given[:2], rates[2:4], strict=True)
        )
        of_internal = rates[4].contiguous() if rates[4] is not None else given.like_result(ctx.law.internal)[1]
        if rates[4] is None and of_internal is not None:
            of_internal.zero_()
        result_rate = given.like_result(ctx.law.after)
        law_input, _kept = _described(ctx.law, given)
        call(
            law_library(ctx.law.text),
            "law_rates",
            given.deformation.dtype,
            ctypes.byref(law_input),
            ctypes.byref(LawFields.of(of_deformation, of_internal)),
            address(of_parameters),
            ctypes.byref(LawFields.of(*ctx.result)),
            ctypes.byref(LawFields.of(*result_rate)),
        )
        return result_rate if ctx.law.after else result_rate[0]
