"""What the kernels take, as C sees it: the structures of source/law_input.hpp and source/exchange.hpp."""

import ctypes
from collections.abc import Sequence
from functools import cache
from typing import NamedTuple, TypeAlias

import torch
from torch import Tensor

Limits: TypeAlias = tuple[tuple[float, float, float], tuple[float, float, float]]


@cache
def _weights_of(layers: int) -> type[ctypes.Structure]:
    """The weights and biases of a network with so many layers, and the units of its layers."""
    fields = [
        ("weights", ctypes.c_void_p * layers),
        ("biases", ctypes.c_void_p * layers),
        ("sizes", ctypes.c_int * (layers + 1)),
    ]
    return type("Weights", (ctypes.Structure,), {"_fields_": fields})


def weights_structure(layers: int, weights: Sequence[Tensor]) -> ctypes.Structure:
    """A network as the kernels read it.

    layers   of the network, or those that the kernel has room for
    weights  contiguous matrices (to, from), then biases, which must outlive it; empty for none
    """
    described = _weights_of(layers)()
    for layer in range(layers if weights else 0):
        described.weights[layer] = weights[layer].data_ptr()
        described.biases[layer] = weights[layers + layer].data_ptr()
        described.sizes[layer], described.sizes[layer + 1] = weights[layer].shape[1], weights[layer].shape[0]
    return described


class LawArrays(NamedTuple):
    """What a law is computed from.

    deformation  F [-], (3, 3, particles), det F > 0
    parameters   that the law's response reads, then further inputs of its network, (rows, particles)
    internal     internal variables, (variables, particles), None without any
    weights      of its network: matrices (to, from), then biases (to, 1)
    """

    deformation: Tensor
    parameters: Tensor
    internal: Tensor | None = None
    weights: Sequence[Tensor] = ()

    def like_result(self, variables: int) -> tuple[Tensor, Tensor | None]:
        """Room for matrices and for internal variables, of which there may be none."""
        after = torch.empty_like(self.internal) if variables and self.internal is not None else None
        return torch.empty_like(self.deformation), after


class LawInput(ctypes.Structure):
    """The particles that a law is computed for.

    weights   the address of Weights, None without a network
    internal  the address of internal variables, None without any
    """

    _fields_ = (
        ("particles", ctypes.c_int64),
        ("deformation", ctypes.c_void_p),
        ("parameters", ctypes.c_void_p),
        ("rows", ctypes.c_int),
        ("weights", ctypes.c_void_p),
        ("internal", ctypes.c_void_p),
    )


class LawFields(ctypes.Structure):
    """A field of matrices and one of internal variables; None where there is none."""

    _fields_ = (("matrix", ctypes.c_void_p), ("internal", ctypes.c_void_p))

    @classmethod
    def of(cls, matrix: Tensor, internal: Tensor | None) -> "LawFields":
        """Those of two contiguous tensors, which must outlive it."""
        return cls(matrix.data_ptr(), internal.data_ptr() if internal is not None else None)


class Corners(ctypes.Structure):
    """The lower and the upper corner of the domain."""

    _fields_ = (("low", ctypes.c_double * 3), ("high", ctypes.c_double * 3))

    @classmethod
    def of(cls, limits: Limits) -> "Corners":
        """Those of two corners [m]."""
        low, high = limits
        return cls((ctypes.c_double * 3)(*low), (ctypes.c_double * 3)(*high))


class Settings(ctypes.Structure):
    """The settings of a step.

    grid   first and last node along each axis
    walls  the address of a byte for each node of the three axes, None where there are no walls
    order  of the affine XPIC of the transfer, 1 for APIC
    """

    _fields_ = (
        ("time_step", ctypes.c_double),
        ("origin", ctypes.c_double * 3),
        ("per_metre", ctypes.c_double),
        ("grid", ctypes.c_int * 6),
        ("contact", ctypes.c_int64),
        ("window", ctypes.c_int64),
        ("walls", ctypes.c_void_p),
        ("order", ctypes.c_int64),
    )


class Bodies(ctypes.Structure):
    """The constants of the particles and scenes."""

    _fields_ = (
        ("particles", ctypes.c_int64),
        ("scenes", ctypes.c_int64),
        ("scene", ctypes.c_void_p),
        ("mass", ctypes.c_void_p),
        ("volume", ctypes.c_void_p),
        ("gravity", ctypes.c_void_p),
    )
