"""The look for particles that have gone wrong, as a kernel."""

import ctypes

import torch
from torch import Tensor

from pcnclaws.compiled import gpu
from pcnclaws.compiled.build import kernel_library
from pcnclaws.compiled.calls import address, call
from pcnclaws.tensor_types import ParticleMask


def failing(position: Tensor, deformation: Tensor) -> ParticleMask:
    """Particles outside of the domain [0, 1]^3, with det F <= 0 or not finite.

    position     [m], (3, particles)
    deformation  F [-], (3, 3, particles)
    """
    position, deformation = position.contiguous(), deformation.contiguous()
    if position.is_cuda:
        return gpu.failing(position, deformation)
    count = position.shape[1]
    failed = torch.empty(count, dtype=torch.bool)
    size = ctypes.byref(ctypes.c_int64(count))
    call(kernel_library(), "failing", position.dtype, size, address(position), address(deformation), address(failed))
    return failed
