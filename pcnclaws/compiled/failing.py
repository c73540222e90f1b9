"""The look for particles that have gone wrong, as a kernel."""

import ctypes

import torch
from torch import Tensor

from pcnclaws.compiled import gpu
from pcnclaws.compiled.build import kernel_library
from pcnclaws.compiled.calls import address, call
from pcnclaws.compiled.structures import Corners, Limits
from pcnclaws.tensors.tensor_types import ParticleMask


def failing(position: Tensor, deformation: Tensor, limits: Limits) -> ParticleMask:
    """Particles outside of the domain, with det F <= 0 or not finite.

    position     [m], (3, particles)
    deformation  F [-], (3, 3, particles)
    limits       lower and upper corner of the domain [m]
    """
    position, deformation = position.contiguous(), deformation.contiguous()
    described = Corners.of(limits)
    if position.is_cuda:
        return gpu.failing(position, deformation, described)
    count = position.shape[1]
    failed = torch.empty(count, dtype=torch.bool)
    size = ctypes.byref(ctypes.c_int64(count))
    arrays = ctypes.byref(described), address(position), address(deformation), address(failed)
    call(kernel_library(), "failing", position.dtype, size, *arrays)
    return failed
