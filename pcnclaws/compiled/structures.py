"""What the kernels take, as C sees it: the structures of source/law_input.hpp and source/exchange.hpp."""

import ctypes
from collections.abc import Sequence
from functools import cache
from typing import TypeAlias

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


class LawInput(ctypes.Structure):
    """The particles that a law is computed for. weights: the address of Weights, None without a network."""

    _fields_ = (
        ("particles", ctypes.c_int64),
        ("deformation", ctypes.c_void_p),
        ("parameters", ctypes.c_void_p),
        ("rows", ctypes.c_int),
        ("weights", ctypes.c_void_p),
    )


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
    """

    _fields_ = (
        ("time_step", ctypes.c_double),
        ("origin", ctypes.c_double * 3),
        ("per_metre", ctypes.c_double),
        ("grid", ctypes.c_int * 6),
        ("contact", ctypes.c_int64),
        ("window", ctypes.c_int64),
        ("walls", ctypes.c_void_p),
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
