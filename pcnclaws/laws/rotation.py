"""Polar decomposition F = R U as one differentiable operation: the rotation and the right stretch."""

from typing import Any

import torch
from torch import Tensor

from pcnclaws.tensors.linalg3 import identity_like, inverse, left_stretch, matmul, trace, transpose
from pcnclaws.tensors.tensor_types import Matrices


def rotation_and_stretch(deformation: Matrices) -> tuple[Matrices, Matrices]:
    """Rotation R and right stretch U of F = R U [-], (3, 3, particles).

    Both have their exact first derivatives, in both modes, where stretches coincide, too: with A = R^T dF the spin
    R^T dR is [w]_x with (tr(U) I - U) w = the axis of A - A^T, and dU = A - [w]_x U.

    deformation  F [-], (3, 3, particles), det F > 0
    """
    return _Polar.apply(deformation)  # pyright: ignore[reportReturnType]


class _Polar(torch.autograd.Function):
    """The linear system of the spin is symmetric, so that tangent and adjoint solve it with the same inverse."""

    @staticmethod
    def forward(ctx: Any, deformation: Tensor) -> tuple[Tensor, Tensor]:
        v, _ = left_stretch(deformation)
        rotation = matmul(inverse(v), deformation.double()).to(deformation.dtype)
        stretch = matmul(transpose(rotation), deformation)
        stretch = 0.5 * (stretch + transpose(stretch))
        ctx.save_for_backward(rotation, stretch)
        ctx.save_for_forward(rotation, stretch)
        return rotation, stretch

    @staticmethod
    def backward(  # pyright: ignore[reportIncompatibleMethodOverride]
        ctx: Any, of_rotation: Tensor, of_stretch: Tensor
    ) -> Tensor:
        rotation, stretch = ctx.saved_tensors
        symmetric = 0.5 * (of_stretch + transpose(of_stretch))
        turning = matmul(transpose(rotation), of_rotation) - matmul(symmetric, stretch)
        return matmul(rotation, symmetric + _spin(stretch, turning))

    @staticmethod
    def jvp(ctx: Any, rate: Tensor) -> tuple[Tensor, Tensor]:  # pyright: ignore[reportIncompatibleMethodOverride]
        rotation, stretch = ctx.saved_tensors
        turned = matmul(transpose(rotation), rate)
        spin = _spin(stretch, turned)
        return matmul(rotation, spin), turned - matmul(spin, stretch)


def _spin(stretch: Matrices, turning: Matrices) -> Matrices:
    """[w]_x with (tr(U) I - U) w = the axis of A - A^T, from U and A."""
    system = inverse(identity_like(stretch) * trace(stretch) - stretch)
    axis = torch.stack((turning[2, 1] - turning[1, 2], turning[0, 2] - turning[2, 0], turning[1, 0] - turning[0, 1]))
    x, y, z = (system * axis).sum(1).unbind(0)
    zero = torch.zeros_like(x)
    return torch.stack((zero, -z, y, z, zero, -x, -y, x, zero)).unflatten(0, (3, 3))
