"""Stretches and rotation of a deformation by an eigenvalue decomposition, with derivatives that are finite everywhere.

The laws of this package need no decomposition; NCLaws is defined with one: its network sees the singular values of F.
"""

from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from pcnclaws.baselines.spectral import Principal, eigen
from pcnclaws.tensors.linalg3 import matmul, transpose
from pcnclaws.tensors.tensor_types import Matrices


def stretches_and_rotation(deformation: Matrices) -> tuple[Principal, Matrices]:
    """Principal stretches [-], decreasing, (3, particles), and the rotation R of F = R S, (3, 3, particles).

    Where stretches coincide their order is arbitrary; each of them keeps a finite derivative, and R has its exact one,
    since that divides by sums of stretches, never by differences.

    deformation  F [-], (3, 3, particles), det F > 0
    """
    f = deformation.detach()
    _, axes = eigen(matmul(transpose(f), f))
    # |F w| has the exact first derivative of a stretch although its axis w is held: an eigenvector is stationary
    stretches = matmul(deformation, axes).square().sum(0).sqrt()
    rotation: Matrices = _PolarRotation.apply(deformation, stretches.detach(), axes)  # pyright: ignore[reportAssignmentType]
    return stretches, rotation


class _PolarRotation(torch.autograd.Function):
    """R = F W diag(1/s) W^T with the stretches s and the axes W of F^T F."""

    @staticmethod
    def forward(ctx: Any, deformation: Tensor, stretches: Tensor, axes: Tensor) -> Tensor:
        rotation = matmul(matmul(deformation, axes / stretches), transpose(axes))
        ctx.save_for_backward(rotation, stretches, axes)
        return rotation

    @staticmethod
    @once_differentiable
    def backward(  # pyright: ignore[reportIncompatibleMethodOverride]  # the decorator is untyped
        ctx: Any, gradient: Tensor
    ) -> tuple[Tensor, None, None]:
        """dR = R W [(W^T (R^T dF - dF^T R) W)_ij / (s_i + s_j)] W^T, which is its own adjoint."""
        rotation, stretches, axes = ctx.saved_tensors
        turned = matmul(transpose(rotation), gradient)
        spin = matmul(matmul(transpose(axes), turned - transpose(turned)), axes)
        spin = spin / (stretches[:, None] + stretches[None])
        return matmul(rotation, matmul(matmul(axes, spin), transpose(axes))), None, None
