"""Isotropic tensor functions given by what they do to principal values."""

from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from pcnclaws.tensors.linalg3 import identity_like, matmul, transpose
from pcnclaws.tensors.tensor_types import Matrices

Principal = Float[Tensor, "3 particles"]


@torch.no_grad()
def eigen(symmetric: Matrices) -> tuple[Principal, Matrices]:
    """Eigenvalues of symmetric matrices, decreasing, (3, particles), and the axes as columns, (3, 3, particles).

    Of a matrix that is not finite, which a diverging simulation ends with, they are those of the identity: whatever
    is computed with the matrix itself still says so.
    """
    finite = torch.isfinite(symmetric).all(0).all(0)
    values, axes = torch.linalg.eigh(torch.where(finite, symmetric, identity_like(symmetric)).permute(2, 0, 1))
    return values.flip(1).T, axes.flip(2).permute(1, 2, 0).contiguous()


def principal_stretches(deformation: Matrices) -> tuple[Principal, Matrices]:
    """Principal stretches [-], decreasing, (3, particles), and their axes in the deformed body, (3, 3, particles).

    Axis i is column i. The axes are held: the stretches have their exact first derivative all the same, since an
    eigenvector is a stationary point of its stretch. from_principal puts back what the turning of the axes contributes.

    deformation  F [-], (3, 3, particles), det F > 0
    """
    f = deformation.detach()
    _, axes = eigen(matmul(f, transpose(f)))
    return matmul(transpose(deformation), axes).square().sum(0).sqrt(), axes


def from_principal(deformation: Matrices, values: Principal, axes: Matrices, slopes: Principal) -> Matrices:
    """The tensor with principal `values` on the axes of b = F F^T, differentiable through values and axes.

    With N the axes: d(N values N^T) = N (dvalues + [slopes_ij (N^T db N)_ij off the diagonal]) N^T.

    slopes  divided differences (values_i - values_j) / (s_i^2 - s_j^2) of the pairs (1, 2), (2, 0), (0, 1), and their
            limit where two stretches s meet, (3, particles)
    source  Daleckii and Krein's formula, for example in Miehe 1998, "Comparison of two algorithms for the computation
            of fourth-order isotropic tensor functions"
    """
    left_cauchy_green = matmul(deformation, transpose(deformation))
    result: Matrices = _FromPrincipal.apply(left_cauchy_green, values, axes, slopes)  # pyright: ignore[reportAssignmentType]
    return result


class _FromPrincipal(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, tensor: Tensor, values: Tensor, axes: Tensor, slopes: Tensor) -> Tensor:
        ctx.save_for_backward(axes, slopes)
        return matmul(axes * values, transpose(axes))

    @staticmethod
    @once_differentiable
    def backward(  # pyright: ignore[reportIncompatibleMethodOverride]  # the decorator is untyped
        ctx: Any, gradient: Tensor
    ) -> tuple[Tensor, Tensor, None, None]:
        axes, slopes = ctx.saved_tensors
        inner = matmul(matmul(transpose(axes), 0.5 * (gradient + transpose(gradient))), axes)
        zero = torch.zeros_like(slopes[0])
        turning = torch.stack((zero, slopes[2], slopes[1], slopes[2], zero, slopes[0], slopes[1], slopes[0], zero))
        along = matmul(matmul(axes, inner * turning.unflatten(0, (3, 3))), transpose(axes))
        return along, inner.diagonal(dim1=0, dim2=1).T, None, None
