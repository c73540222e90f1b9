"""Principal axes of deformation gradients of any scale and grading, (3, 3, particles), for the few far from 1.

linalg3 computes isotropic functions without axes, which serves stretches of about 1 and keeps derivatives finite where
stretches coincide. Far from there its series end and its sums cancel; here every stretch keeps its digits, a thousand
times slower. Axes are found once and not differentiated: the functions add first derivatives of their own.
"""

from collections.abc import Callable

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from pcnclaws.tensors.tensor_types import Matrices
from pcnclaws.tensors.twofold import Twofold, product_of

Batch = Float[Tensor, "particles 3 3"]
Values = Float[Tensor, "particles 3"]
MOST_SWEEPS = 40
# Two arguments meet where the rounding of their difference weighs as much as the curvature of a function.
MEETING = 1e-9


def graded_hencky_strain(deformation: Matrices) -> Matrices:
    """Hencky strain h = 1/2 log(F F^T) [-], differentiable once.

    deformation  F [-], (3, 3, particles), det F > 0, of any scale; NaN is returned where det F <= 0
    """
    f = _batch_first(deformation)
    q, g, upright = principal_axes(f.detach())
    square = g.square().sum(2)
    strain = torch.where(upright[:, None], 0.5 * square.log(), torch.nan)
    half = q.mT @ (f - f.detach()) @ g.mT  # rate of F in principal axes; b = F F^T
    differences = divided_differences(square, strain, lambda b: 0.5 / b)
    return _batch_last(q @ (torch.diag_embed(strain) + differences * (half + half.mT)) @ q.mT).to(deformation.dtype)


def graded_stretch(strain: Matrices, deformation: Matrices) -> Matrices:
    """exp(A) F for a strain A that shares its axes with F F^T, differentiable once.

    strain       A [-], symmetric, (3, 3, particles)
    deformation  F [-], (3, 3, particles), of any scale
    """
    f, a = _batch_first(deformation), _batch_first(strain)
    q, g, _ = principal_axes(f.detach())
    a = q.mT @ a @ q
    values = a.detach().diagonal(dim1=1, dim2=2)
    stretch = values.exp()[:, :, None]
    change = divided_differences(values, values.exp(), torch.exp) * (a - a.detach())
    return _batch_last(q @ (stretch * (g + q.mT @ (f - f.detach())) + change @ g)).to(deformation.dtype)


def divided_differences(x: Values, y: Values, slope: Callable[[Tensor], Tensor]) -> Batch:
    """(y_i - y_j)/(x_i - x_j), and dy/dx where two arguments meet: the derivative of an isotropic function in
    principal axes (Daleckii and Krein 1965)."""
    first, second = x[:, :, None], x[:, None, :]
    meets = (first - second).abs() <= MEETING * (first.abs() + second.abs()).clamp_min(MEETING)
    return torch.where(
        meets,
        slope(0.5 * (first + second)),
        (y[:, :, None] - y[:, None, :]) / torch.where(meets, 1.0, first - second),
    )


def principal_axes(f: Batch) -> tuple[Batch, Batch, Bool[Tensor, " particles"]]:
    """Q and G with F = Q G, Q orthogonal and the rows of G orthogonal to each other; and whether det F > 0.

    From F = L D U by complete pivoting and L = Q R: one-sided Jacobi rotations of R D U, whose rows fall as D does,
    keep the digits of small stretches beside large ones (Demmel et al. 1999, "Computing the singular value
    decomposition with high relative accuracy").
    """
    # squares neither overflow nor vanish beside a largest entry of about 1; a power of two changes no digit
    exponent = torch.frexp(f.abs().amax((1, 2), keepdim=True)).exponent
    rows, columns, lower, d, upper, even = _completely_pivoted(torch.ldexp(f, -exponent))
    negative = (d < 0.0).sum(1) % 2 == 1
    upright = (d[:, 2] != 0.0) & (negative != even) & f.isfinite().all(2).all(1)
    lower = torch.where(upright[:, None, None], lower, torch.eye(3).to(f))
    q, r = torch.linalg.qr(lower)
    g = torch.zeros_like(f).scatter_(2, columns[:, None, :].expand_as(f), r @ (d[:, :, None] * upper))
    q = torch.zeros_like(f).scatter_(1, rows[:, :, None].expand_as(f), q)
    for _ in range(MOST_SWEEPS):
        if not orthogonalise(q, g).any():
            break
    return q, torch.ldexp(g, exponent), upright


def orthogonalise(q: Batch, g: Batch) -> Bool[Tensor, " particles"]:
    """One sweep of one-sided Jacobi rotations of the rows of G (Hestenes 1958), in place, that keeps Q G.

    Returns the particles whose rows were not orthogonal.
    """
    turning = torch.zeros_like(g[:, 0, 0], dtype=torch.bool)
    for p, s in ((0, 1), (0, 2), (1, 2)):
        turning = turning | _turn_rows(q, g, p, s)
    return turning


def _completely_pivoted(f: Batch) -> tuple[Tensor, Tensor, Batch, Values, Batch, Tensor]:
    """Rows and columns of F in such an order, and factors, that F[rows_i, columns_j] = (L D U)_ij.

    L and U have a diagonal of 1 and no entry above 1, D falls; at last whether the product of both orders is even.

    What elimination leaves of F are its minors over the pivots so far: formed of F itself and to twice the digits, they
    are right where differences of products cancel.
    """
    count = len(f)
    rest, lower, upper = f.clone(), *(torch.eye(3).to(f).repeat(count, 1, 1) for _ in range(2))
    order = torch.arange(3, device=f.device).repeat(count, 1)
    rows, columns, even = order, order, torch.ones(count, dtype=torch.bool, device=f.device)
    d = torch.zeros_like(f[:, 0])
    for k in range(3):
        largest = rest[:, k:, k:].abs().flatten(1).argmax(1)
        row, column = k + largest // (3 - k), k + largest % (3 - k)
        of_rows, of_columns = _exchanged(order, row, k), _exchanged(order, column, k)
        rows, columns = rows.gather(1, of_rows), columns.gather(1, of_columns)
        f, rest = (_ordered(_ordered(matrix, of_rows, 1), of_columns, 2) for matrix in (f, rest))
        lower[:, :, :k], upper[:, :k] = _ordered(lower[:, :, :k], of_rows, 1), _ordered(upper[:, :k], of_columns, 2)
        even = even == ((row == k) == (column == k))
        pivot = d[:, k] = rest[:, k, k]
        safe = torch.where(pivot == 0.0, 1.0, pivot)
        lower[:, k + 1 :, k] = rest[:, k + 1 :, k] / safe[:, None]
        upper[:, k, k + 1 :] = rest[:, k, k + 1 :] / safe[:, None]
        if k == 0:
            rest[:, 1:, 1:] = _minors(f) / safe[:, None, None]
        elif k == 1:
            rest[:, 2, 2] = torch.where(pivot == 0.0, 0.0, _determinant(f) / d[:, 0] / safe)
    return rows, columns, lower, d, upper, even


def _minors(f: Batch) -> Float[Tensor, "particles 2 2"]:
    """F_00 F_ij - F_0j F_i0 for i and j from 1."""
    kept = product_of(f[:, :1, :1], f[:, 1:, 1:])
    return kept.plus(product_of(-f[:, :1, 1:], f[:, 1:, :1])).high


def _determinant(f: Batch) -> Tensor:
    first, second, third = f.unbind(2)

    def cofactor(row: int, i: int, j: int) -> Twofold:
        minor = product_of(second[:, i], third[:, j]).plus(product_of(-second[:, j], third[:, i]))
        return minor.times(first[:, row])

    return cofactor(0, 1, 2).plus(cofactor(1, 2, 0)).plus(cofactor(2, 0, 1)).high


def _exchanged(order: Tensor, other: Tensor, k: int) -> Tensor:
    """The order in which k and another number have changed places."""
    return order.scatter(1, other[:, None], k).index_copy(1, torch.tensor([k], device=order.device), other[:, None])


def _ordered(values: Tensor, order: Tensor, dim: int) -> Tensor:
    index = order[:, :, None] if dim == 1 else order[:, None, :]
    return values.gather(dim, index.expand_as(values))


def _turn_rows(q: Batch, g: Batch, p: int, s: int) -> Tensor:
    """Makes rows p and s of G orthogonal and keeps Q G, in place. Returns the particles whose rows were not."""
    first, second = g[:, p], g[:, s]
    alpha, beta, gamma = first.square().sum(1), second.square().sum(1), (first * second).sum(1)
    turns = gamma.abs() > 1e-16 * alpha.sqrt() * beta.sqrt()
    # the cotangent of twice the angle may overflow: then there is no angle
    cotangent = (beta - alpha) / torch.where(turns, 2.0 * gamma, 1.0)
    size = cotangent.abs() + (1.0 + cotangent.square()).sqrt()
    tangent = torch.where(turns, torch.where(cotangent < 0.0, -1.0, 1.0) / size, 0.0)[:, None]
    cosine = (1.0 + tangent.square()).rsqrt()
    g[:, p], g[:, s] = cosine * (first - tangent * second), cosine * (second + tangent * first)
    first, second = q[:, :, p].clone(), q[:, :, s].clone()
    q[:, :, p], q[:, :, s] = cosine * (first - tangent * second), cosine * (second + tangent * first)
    return turns


def _batch_first(matrices: Matrices) -> Batch:
    return matrices.double().permute(2, 0, 1)


def _batch_last(matrices: Batch) -> Matrices:
    return matrices.permute(1, 2, 0)
