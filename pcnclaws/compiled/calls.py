"""Calls of the C++ kernels: when they serve, and how tensors reach them."""

import ctypes
from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor
from torch._C import _functorch  # pyright: ignore[reportAttributeAccessIssue]  # there is no public way to ask
from torch.autograd import forward_ad

from pcnclaws.compiled.backend import configured_backend
from pcnclaws.compiled.build import kernel_library
from pcnclaws.compiled.gpu_build import gpu_serves
from pcnclaws.errors import UserError

SUFFIXES = {torch.float32: "float32", torch.float64: "float64"}
# what a kernel returns
REFUSED, OUT_OF_MEMORY = 1, 2


def kernels_serve(
    state: Tensor, inputs: Sequence[Tensor] = (), constants: Sequence[Tensor] = (), weights: Sequence[Tensor] = ()
) -> bool:
    """Whether the kernels compute with these tensors now.

    They do on the CPU and on a GPU, in single and double precision, unless simulation.backend=torch, a function
    transform or a compiler of PyTorch is at work, or a derivative is asked for that they do not have: forward mode on a
    GPU, for one. On a GPU they add up in an order that differs from run to run: with
    torch.use_deterministic_algorithms(True) they do not serve there.

    state      any field of the state
    inputs     what else enters and has derivatives
    constants  what has none: mass, volume, gravity
    weights    what has none in forward mode
    raises     UserError for simulation.backend=compiled where the kernels cannot be compiled, or must not run
    """
    if configured_backend() == "torch" or state.device.type not in ("cpu", "cuda") or state.dtype not in SUFFIXES:
        return False
    if torch.compiler.is_compiling() or in_function_transform():
        return False
    everything = (state, *inputs, *constants, *weights)
    if any(tensor.dtype != state.dtype or tensor.device != state.device for tensor in everything):
        return False  # PyTorch has its say
    if torch.is_grad_enabled() and any(tensor.requires_grad for tensor in constants):
        return False
    if state.is_cuda:
        return _gpu_kernels_serve() and not in_forward_mode()
    if in_forward_mode() and not _has_forward_mode(everything, (*constants, *weights)):
        return False
    if kernel_library() is None:
        if configured_backend() == "compiled":
            raise UserError("simulation.backend=compiled needs a C++ compiler (g++); accepted here: auto, torch")
        return False
    return True


def _gpu_kernels_serve() -> bool:
    compiled = configured_backend() == "compiled"
    if torch.are_deterministic_algorithms_enabled():
        if compiled:
            raise UserError(
                "simulation.backend=compiled adds up in another order in each run on a GPU, and deterministic "
                "algorithms are asked for; accepted: auto, torch"
            )
        return False
    if compiled and not gpu_serves():
        raise UserError("simulation.backend=compiled needs NVRTC, a part of PyTorch for GPUs; accepted: auto, torch")
    return gpu_serves()


def in_function_transform() -> bool:
    """Whether a transform of torch.func is at work."""
    return _functorch.maybe_current_level() is not None


def in_forward_mode() -> bool:
    """Whether forward-mode derivatives may be at work."""
    return forward_ad._current_level >= 0


def derivatives_wanted() -> bool:
    """Whether derivatives in either mode may be asked for of what is computed now."""
    return torch.is_grad_enabled() or in_forward_mode()


def carries_rates(tensors: Sequence[Tensor]) -> bool:
    """Whether one of the tensors carries a forward-mode derivative now."""
    return in_forward_mode() and any(forward_ad.unpack_dual(tensor).tangent is not None for tensor in tensors)


def require_first_derivative() -> None:
    """Refuses, in a backward pass, to be differentiated again, which would be wrong without a word."""
    if torch.is_grad_enabled():
        raise RuntimeError("the compiled kernels have first derivatives only; choose simulation.backend=torch")


def call(library: ctypes.CDLL | None, name: str, dtype: torch.dtype, *arguments: Any) -> None:
    """Runs a kernel of a library on the threads that PyTorch uses. Arguments are addresses."""
    status = getattr(library, f"{name}_{SUFFIXES[dtype]}")(*arguments, ctypes.c_int(torch.get_num_threads()))
    if status == OUT_OF_MEMORY:
        raise MemoryError(f"not enough memory for the grid of the kernel '{name}'")
    if status == REFUSED:
        raise ValueError(
            f"the kernel '{name}' refuses its input: scene_index must increase from 0 to below the number of scenes, "
            "and rows of parameters and networks must fit the law"
        )


def addresses(*tensors: Tensor | None) -> Any:
    """The addresses of contiguous tensors as a C array; null for None. The tensors must outlive the call."""
    return (ctypes.c_void_p * len(tensors))(*(None if tensor is None else tensor.data_ptr() for tensor in tensors))


def address(tensor: Tensor | None) -> ctypes.c_void_p:
    """The address of a contiguous tensor; null for None. The tensor must outlive the call."""
    return ctypes.c_void_p(None if tensor is None else tensor.data_ptr())


def _has_forward_mode(everything: Sequence[Tensor], constants: Sequence[Tensor]) -> bool:
    """False for both modes at once, and for rates of what stays constant."""
    if torch.is_grad_enabled() and any(tensor.requires_grad for tensor in everything):
        return False
    return all(forward_ad.unpack_dual(tensor).tangent is None for tensor in constants)
