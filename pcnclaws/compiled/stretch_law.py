"""Laws that a network makes of the right stretch as a kernel, differentiable in reverse mode, on a CPU.

The formulas are those of laws/neural_paper.py.
"""

import ctypes
from collections.abc import Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

from pcnclaws.compiled.build import stretch_law_library
from pcnclaws.compiled.calls import address, addresses, call, in_forward_mode, kernels_serve, require_first_derivative
from pcnclaws.compiled.structures import weights_structure

LAYERS = 3
# Features of the stretch, components of the output, and what is added to |dev|^2 where it divides.
FEATURES, OUTPUTS, SMALLEST = 10, 6, 1e-12


class StretchLaw(NamedTuple):
    """What distinguishes one of these laws from another.

    returns_strain  its result is a deformation gradient
    own_size        its unit of strain grows with strain
    """

    returns_strain: bool
    own_size: bool


class _StretchLaw(ctypes.Structure):
    _fields_ = (
        ("particles", ctypes.c_int64),
        ("deformation", ctypes.c_void_p),
        ("rows", ctypes.c_void_p),
        ("conditions", ctypes.c_int),
        ("returns_strain", ctypes.c_int),
        ("own", ctypes.c_double),
        ("weights", ctypes.c_void_p),
    )


def stretch_law_serves(deformation: Tensor, rows: Tensor, weights: Sequence[Tensor]) -> bool:
    """Whether the kernel computes with these tensors now: on a CPU, for networks with two hidden layers."""
    if deformation.is_cuda or len(weights) != 2 * LAYERS or not kernels_serve(deformation, (rows,), weights=weights):
        return False
    return not in_forward_mode() and stretch_law_library() is not None


def stretch_law(law: StretchLaw, deformation: Tensor, rows: Tensor, weights: Sequence[Tensor]) -> Tensor:
    """Kirchhoff stress [Pa] or elastic deformation gradient [-], (3, 3, particles).

    rows     conditions, output at rest, unit of strain, factor of the output, (rows, particles)
    weights  of the network: matrices (to, from), then biases (to, 1)
    """
    return _Law.apply(law, deformation, rows, *weights)  # pyright: ignore[reportReturnType]


class _Law(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, law: StretchLaw, *tensors: Tensor) -> Tensor:
        deformation, rows, *weights = (tensor.contiguous() for tensor in tensors)
        ctx.law = law
        ctx.save_for_backward(deformation, rows, *weights)
        result = torch.empty_like(deformation)
        given, _kept = _described(law, deformation, rows, weights)
        call(stretch_law_library(), "stretch_law_forward", deformation.dtype, ctypes.byref(given), address(result))
        return result

    @staticmethod
    def backward(  # pyright: ignore[reportIncompatibleMethodOverride]
        ctx: Any, incoming: Tensor
    ) -> tuple[Tensor | None, ...]:
        require_first_derivative()
        deformation, rows, *weights = ctx.saved_tensors
        incoming, gradient = incoming.contiguous(), torch.empty_like(deformation)
        of_rows = torch.empty_like(rows) if ctx.needs_input_grad[2] else None
        of_weights = [torch.empty_like(weight) for weight in weights] if any(ctx.needs_input_grad[3:]) else []
        given, _kept = _described(ctx.law, deformation, rows, weights)
        call(
            stretch_law_library(),
            "stretch_law_adjoint",
            deformation.dtype,
            ctypes.byref(given),
            address(incoming),
            address(gradient),
            address(of_rows),
            addresses(*of_weights) if of_weights else None,
        )
        return (None, gradient, of_rows, *(of_weights or [None] * len(weights)))


def _described(
    law: StretchLaw, deformation: Tensor, rows: Tensor, weights: Sequence[Tensor]
) -> tuple[_StretchLaw, Any]:
    """The kernel's input, and what must stay alive while it runs."""
    network = weights_structure(LAYERS, weights)
    pointer = ctypes.cast(ctypes.pointer(network), ctypes.c_void_p)
    given = _StretchLaw(
        deformation.shape[2],
        deformation.data_ptr(),
        rows.data_ptr(),
        len(rows) - OUTPUTS - 2,
        int(law.returns_strain),
        float(law.own_size),
        pointer,
    )
    return given, network
