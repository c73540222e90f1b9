"""Calls of the C++ kernels: when they serve, and how tensors reach them."""

import ctypes
from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor
from torch._C import _functorch  # pyright: ignore[reportAttributeAccessIssue]  # there is no public way to ask
from torch.autograd import forward_ad

from pcnclaws.backend import configured_backend
from pcnclaws.compiled.build import kernel_library

SUFFIXES = {torch.float32: "float32", torch.float64: "float64"}
Pointers = Any


def kernels_serve(state: Tensor, constants: Sequence[Tensor] = (), weights: Sequence[Tensor] = ()) -> bool:
    """Whether the kernels compute with these tensors now.

    They do on the CPU, in single and double precision, unless simulation.backend=torch, a function transform or a
    compiler of PyTorch is at work, or a derivative is asked for that they do not have: with respect to one of the
    `constants`, or in forward mode with respect to one of the `weights`.
    """
    return (
        configured_backend() != "torch"
        and state.device.type == "cpu"
        and state.dtype in SUFFIXES
        and not torch.compiler.is_compiling()
        and _functorch.maybe_current_level() is None
        and not (torch.is_grad_enabled() and any(tensor.requires_grad for tensor in constants))
        and not (forward_ad._current_level >= 0 and any(_has_tangent(tensor) for tensor in (*constants, *weights)))
        and kernel_library() is not None
    )


def call(name: str, dtype: torch.dtype, *arguments: Any) -> None:
    """Runs a kernel on the threads that PyTorch uses."""
    function = getattr(kernel_library(), f"{name}_{SUFFIXES[dtype]}")
    # every argument but the number of the law and of threads is an address
    converted = [ctypes.c_int(a) if isinstance(a, int) else a for a in arguments]
    if function(*converted, ctypes.c_int(torch.get_num_threads())) != 0:
        raise ValueError(f"the kernel '{name}' was called with arguments it does not know")


def addresses(*tensors: Tensor | None) -> Pointers:
    """The addresses of contiguous tensors as a C array; null for None."""
    return (ctypes.c_void_p * len(tensors))(*(None if tensor is None else tensor.data_ptr() for tensor in tensors))


def address(tensor: Tensor | None) -> Pointers:
    """The address of a contiguous tensor; null for None."""
    return ctypes.c_void_p(None if tensor is None else tensor.data_ptr())


def _has_tangent(tensor: Tensor) -> bool:
    return forward_ad.unpack_dual(tensor).tangent is not None
