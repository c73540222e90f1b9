"""Isotropic laws in PyTorch: from functions of three principal Hencky strains to functions of F, and their derivatives.

With b = F F^T = Q diag(b) Q^T a law is Y(b) = Q diag(y) Q^T. Its derivative in principal axes is that of y on the
diagonal and a divided difference of y off it (Daleckii and Krein 1965). The axes are found once and not differentiated:
what is returned has exact first derivatives in both modes, and no second ones.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from pcnclaws.tensors.graded_axes import orthogonalise, principal_axes
from pcnclaws.tensors.tensor_types import Matrices

Principal = Float[Tensor, "3 particles"]
# Three principal strains (3, particles) to three principal values, and what else follows from them, (3 and more,
# particles), in double precision.
Response = Callable[[Principal], Float[Tensor, "values particles"]]
# Two squared stretches meet where the rounding of their difference weighs as much as the curvature of a law that flows
# at strains of 1e-6.
MEETING = 4e-9
# Squared stretches of which axes that are found from F F^T keep the digits, with so many sweeps over the rows of Q^T F.
LEAST, MOST, SWEEPS = 1e-4, 1e4, 3
# Whether what is computed may not depend on a look at the numbers.
_BLIND = ContextVar("blind", default=False)
# Changes of strain beyond which F + (e^y - 1) F would cancel.
LARGE = 1.0


def stress(deformation: Matrices, response: Response) -> Matrices:
    """Kirchhoff stress [Pa], (3, 3, particles), of a response that gives principal stresses [Pa].

    deformation  F [-], (3, 3, particles), det F > 0; NaN is returned where it is not
    """
    axes = _axes(deformation)
    y = response(axes.strain)
    off = _divided_differences(axes.square, y.detach(), response, axes.strain.detach())
    return _turned(axes.q, torch.diag_embed(y.T) + off * axes.change, axes.q.mT).to(deformation.dtype)


def elastic_deformation(
    deformation: Matrices, response: Response
) -> tuple[Matrices, Float[Tensor, "variables particles"]]:
    """Elastic deformation gradient [-], (3, 3, particles), of a response that gives the strains after plastic flow.

    Exactly F where the strains stay the same.
    returns  it, and what else the response gives: internal variables after plastic flow
    """
    axes = _axes(deformation)
    after, internal = response(axes.strain).tensor_split([3])
    change = after - axes.strain
    # F' = Q diag(e^y) Q^T F, as F + Q diag(e^y - 1) Q^T F where that is more accurate
    small = (change.detach().abs().amax(0) < LARGE)[:, None, None].to(change.dtype)
    stretch = change.exp()
    # e^y - 1, whose differences have more digits than those of e^y
    off = _divided_differences(
        axes.square, change.detach().expm1(), lambda h: (response(h)[:3] - h).expm1(), axes.strain.detach()
    )
    g = axes.g + axes.q.mT @ (axes.f - axes.f.detach())
    turned = torch.diag_embed(stretch.T - small[:, :, 0]) @ g + (off * axes.change) @ axes.g
    result = small * axes.f + axes.q @ turned
    return result.movedim(0, -1).to(deformation.dtype), internal


@contextmanager
def without_a_look() -> Iterator[None]:
    """Laws in the block do the same operations whatever the numbers are, as programs need that are traced.

    Stretches outside of 0.01 to 100 lose digits then.
    """
    before = _BLIND.set(True)
    try:
        yield
    finally:
        _BLIND.reset(before)


def strains(deformation: Matrices) -> Principal:
    """Principal Hencky strains [-], in double precision, (3, particles)."""
    return _axes(deformation).strain


class _Axes(NamedTuple):
    """F and its principal axes, the particles first.

    f       (particles, 3, 3)
    q       axes as columns, not differentiated, (particles, 3, 3)
    g       Q^T F, not differentiated, (particles, 3, 3)
    square  principal values of b, not differentiated, (particles, 3)
    strain  principal Hencky strains [-], differentiable, (3, particles)
    change  Q^T (b - b) Q: zeros that carry the derivative of b, (particles, 3, 3)
    """

    f: Tensor
    q: Tensor
    g: Tensor
    square: Tensor
    strain: Principal
    change: Tensor


def _axes(deformation: Matrices) -> _Axes:
    f = deformation.double().movedim(-1, 0)
    q, g, upright = _found_axes(f.detach())
    square = g.square().sum(2)
    half = q.mT @ (f - f.detach()) @ g.mT
    change = half + half.mT
    strain = (
        torch.where(upright[:, None], 0.5 * square.log(), torch.nan) + 0.5 * change.diagonal(dim1=1, dim2=2) / square
    )
    return _Axes(f, q, g, square, strain.T, change)


@torch.no_grad()
def _found_axes(f: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Q, Q^T F and whether det F > 0; of a state that is not finite, Q is the identity and strains are not numbers."""
    b = f @ f.mT
    finite = torch.isfinite(b).all(2).all(1)
    q = torch.linalg.eigh(
        torch.where(finite[:, None, None], b, torch.eye(3, dtype=b.dtype, device=b.device))
    ).eigenvectors
    g, upright = q.mT @ f, torch.linalg.det(f) > 0.0
    for _ in range(SWEEPS):
        turning = orthogonalise(q, g)
        if _may_look(f) and not bool(turning.any()):
            break
    if not _may_look(f):
        return q, g, upright
    square = g.square().sum(2)
    far = (finite & ~((square > LEAST) & (square < MOST)).all(1)).nonzero()[:, 0]
    if len(far):
        q[far], g[far], upright[far] = principal_axes(f[far])
    return q, g, upright


def _may_look(values: Tensor) -> bool:
    """Whether what is computed may depend on a look at the numbers: not on a GPU, where it would wait for them."""
    return not values.is_cuda and not _BLIND.get()


def _divided_differences(square: Tensor, y: Principal, response: Response, strain: Principal) -> Tensor:
    """(y_i - y_j)/(b_i - b_j), and its limit where two meet, (particles, 3, 3); nothing of use on the diagonal."""
    first, second, y = square[:, :, None], square[:, None, :], y.T
    meets = (first - second).abs() <= MEETING * (first + second)
    differences = (y[:, :, None] - y[:, None, :]) / torch.where(meets, 1.0, first - second)
    off_diagonal = ~torch.eye(3, dtype=torch.bool, device=square.device)
    if _may_look(square) and not bool((meets & off_diagonal).any()):
        return differences * off_diagonal
    slope = _slopes(response, strain)  # [:, i, j] = d y_i / d h_j
    own = slope.diagonal(dim1=1, dim2=2)
    limit = 0.25 * ((own[:, :, None] - slope.mT) / first + (own[:, None, :] - slope) / second)
    return torch.where(meets, limit, differences) * off_diagonal


def _slopes(response: Response, strain: Principal) -> Tensor:
    """The derivatives of a response, (particles, 3 values, 3 strains), not differentiated themselves."""
    with torch.enable_grad():
        y, pull = torch.func.vjp(response, strain)[:2]
        rows = [pull(torch.zeros_like(y).index_fill(0, torch.tensor([k], device=y.device), 1.0))[0] for k in range(3)]
    return torch.stack(rows).detach().permute(2, 0, 1)


def _turned(q: Tensor, middle: Tensor, back: Tensor) -> Matrices:
    return (q @ middle @ back).movedim(0, -1)
