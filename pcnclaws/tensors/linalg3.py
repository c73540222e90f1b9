"""Batched algebra of 3x3 matrices stored component-first, (3, 3, particles), with derivatives finite everywhere.

No singular values or eigenvalues are computed: isotropic functions of a matrix are written with its
invariants and the Cayley-Hamilton theorem, so nothing is divided by a difference of stretches, and the
derivatives stay finite where stretches coincide, which is where every simulation starts (F = I). What is far
from there is left to graded_axes.
"""

import functools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from pcnclaws.tensors.graded_axes import graded_hencky_strain, graded_stretch
from pcnclaws.tensors.tensor_types import Matrices, ParticleMask, Scalars

# Stretches that the series for logarithm and exponential serve.
LEAST_STRETCH, MOST_STRETCH = 0.05, 20.0
MOST_STRAIN = 3.0  # and strains, their logarithms


def matmul(a: Matrices, b: Matrices) -> Matrices:
    """Matrix product A B."""
    (a0, a1, a2), (b0, b1, b2) = a.unbind(1), b.unbind(0)
    return torch.addcmul(torch.addcmul(a0[:, None] * b0, a1[:, None], b1), a2[:, None], b2)


def transpose(a: Matrices) -> Matrices:
    """A^T."""
    return a.transpose(0, 1)


def identity_like(a: Matrices) -> Float[Tensor, "3 3 1"]:
    """The identity, broadcastable to the shape of a, (3, 3, 1)."""
    return torch.eye(3, dtype=a.dtype, device=a.device)[:, :, None]


def trace(a: Matrices) -> Scalars:
    """tr A."""
    return a.diagonal(dim1=0, dim2=1).sum(-1)


def cofactors(a: Matrices) -> Matrices:
    """Cofactor matrix det(A) A^-T."""
    wrapped = torch.cat((a, a[:2]))
    wrapped = torch.cat((wrapped, wrapped[:, :2]), dim=1)
    return wrapped[1:4, 1:4] * wrapped[2:, 2:] - wrapped[1:4, 2:] * wrapped[2:, 1:4]


def determinant(a: Matrices) -> Scalars:
    """det A."""
    (a00, a01, a02), (a10, a11, a12), (a20, a21, a22) = (row.unbind(0) for row in a.unbind(0))
    return a00 * (a11 * a22 - a12 * a21) + a01 * (a12 * a20 - a10 * a22) + a02 * (a10 * a21 - a11 * a20)


def deviator(a: Matrices) -> Matrices:
    """A - tr(A)/3 I."""
    return a - identity_like(a) * (trace(a) / 3.0)


def safe_norm(a: Matrices) -> Scalars:
    """Frobenius norm with derivative 0 (a subgradient) where the matrix is 0."""
    squared = a.square().sum((0, 1))
    positive = squared > 0.0
    return torch.where(positive, torch.where(positive, squared, 1.0).sqrt(), 0.0)


def inverse(a: Matrices) -> Matrices:
    """Inverse by cofactors."""
    minors = cofactors(a)
    return transpose(minors) / (a[0] * minors[0]).sum(0)


def left_stretch(deformation: Matrices) -> tuple[Matrices, Matrices]:
    """Left stretch V and left Cauchy-Green tensor b = V^2 = F F^T of a deformation F with det F > 0, in float64.

    V is a combination of I, b and adj(b) = cof(F) cof(F)^T whose coefficients are the invariants of V (Hoger and
    Carlson 1984, "Determination of the stretch and rotation in the polar decomposition of the deformation
    gradient", with Cayley-Hamilton for b^2).
    float64 also for float32 input: in float32 the square F F^T alone would lose small stretches.
    """
    found = _left_stretch(deformation)
    return found.v, found.b


def hencky_strain(deformation: Matrices) -> Matrices:
    """Hencky (logarithmic) strain h = log V = 1/2 log(F F^T) [-] of a deformation F with det F > 0.

    Right to 1e-12 for float64 input, to 1e-6 for float32 input; on a GPU, which does not wait for a look at the
    numbers, for stretches from LEAST_STRETCH to MOST_STRETCH.
    """
    found = _left_stretch(deformation)
    far = _where(found.far)
    if far is None:
        return _log_of_left_stretch(found, deformation.dtype)
    near = _log_of_left_stretch(_left_stretch(_identity_where(found.far, deformation)), deformation.dtype)
    return near.index_copy(2, far, graded_hencky_strain(deformation[:, :, far]))


def stretched(strain: Matrices, deformation: Matrices) -> Matrices:
    """exp(A) F: the deformation F after a further strain A along the principal axes of F F^T; F itself where A = 0.

    strain       A [-], symmetric, (3, 3, particles)
    deformation  F [-], (3, 3, particles), det F > 0
    """
    far = _where(strain.detach().abs().amax((0, 1)) > MOST_STRAIN)
    if far is None:
        return matmul(exp_symmetric(strain), deformation)
    large = torch.zeros_like(strain[0, 0], dtype=torch.bool).index_fill(0, far, True)
    near = matmul(exp_symmetric(torch.where(large, 0.0, strain)), deformation)
    return near.index_copy(2, far, graded_stretch(strain[:, :, far], deformation[:, :, far]))


def exp_symmetric(a: Matrices) -> Matrices:
    """Matrix exponential of a symmetric matrix; exp(0) is exactly I.

    exp(A) = e^(tr A / 3) exp(dev A); the second factor by scaling and squaring of a Taylor polynomial. A deviator
    obeys A^3 = a2 A + a3 I (Cayley-Hamilton), so A^n = a3 g_(n-1) I + g_(n+1) A + g_n A^2 with
    g_(n+1) = a2 g_(n-1) + a3 g_(n-2).
    """
    scaled = deviator(a) * 0.5**_EXP_SQUARINGS
    squared = matmul(scaled, scaled)
    a2, a3 = 0.5 * trace(squared), determinant(scaled)
    weights = _EXP_WEIGHTS[a.dtype]
    g = [torch.zeros_like(a2), torch.ones_like(a2), torch.zeros_like(a2), torch.zeros_like(a2) + a2]
    # g[k] is g_(k+1): g_1 = 0, g_2 = 1, g_3 = 0, g_4 = a2
    while len(g) < len(weights[0]):
        g.append(torch.addcmul(a3 * g[-3], a2, g[-2]))
    of_i, of_a, of_squared = _weighted_sums(weights, g)
    result = identity_like(a) * (1.0 + a3 * of_i) + of_a * scaled + of_squared * squared
    for _ in range(_EXP_SQUARINGS):
        result = matmul(result, result)
    return result * torch.exp(trace(a) / 3.0)


Table = tuple[tuple[float, ...], ...]


def _gauss_legendre(count: int) -> tuple[tuple[float, ...], Table]:
    """Nodes t on [0, 1], and weights of the moments of order 0, 1 and 2."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    t, w = 0.5 * (nodes + 1.0), 0.5 * weights
    return tuple(t.tolist()), _table(np.stack((w, w * t, w * t * t)))


def _exp_weights(terms: int) -> Table:
    """Weights 1/n! that sum g_1 .. g_(terms + 1) to the coefficients of I (over a3), A and A^2."""
    weights = np.zeros((3, terms + 1))
    for n in range(1, terms + 1):
        if n >= 2:
            weights[0, n - 2] = 1.0 / math.factorial(n)
        weights[1, n] = 1.0 / math.factorial(n)
        weights[2, n - 1] = 1.0 / math.factorial(n)
    return _table(weights)


def _table(values: np.ndarray) -> Table:
    return tuple(tuple(row) for row in values.tolist())


# right to 1e-13 and 1e-7
_LOG_QUADRATURE = {
    torch.float64: _gauss_legendre(15),
    torch.float32: _gauss_legendre(9),
}
_EXP_SQUARINGS = 2
_EXP_WEIGHTS = {torch.float64: _exp_weights(16), torch.float32: _exp_weights(10)}


def _weighted_sums(weights: Table, rows: Sequence[Scalars]) -> Tensor:
    """Weighted sums of some rows, (sums, particles)."""
    stacked = torch.stack(list(rows))
    return _constant(weights, stacked.dtype, stacked.device) @ stacked


@functools.cache
def _constant(values: Table, dtype: torch.dtype, device: torch.device) -> Tensor:
    """A table on a device, copied there once: a copy in every step would wait for the device."""
    with torch.inference_mode(False):  # which could not be differentiated later
        return torch.tensor(values, dtype=dtype, device=device)


def _moments_of_inverse_determinant(i1: Scalars, i2: Scalars, i3: Scalars, precision: torch.dtype) -> Tensor:
    """int_0^1 t^k / det(I + t Y) dt for k = 0, 1, 2 from the invariants of Y, (3, particles).

    The nodes are enough for Y + I between sqrt(0.05) and sqrt(20).
    """
    nodes, weights = _LOG_QUADRATURE[precision]
    t = _constant((nodes,), i1.dtype, i1.device).T
    determinants = 1.0 + t * (i1 + t * (i2 + t * i3))
    return _constant(weights, i1.dtype, i1.device) @ determinants.reciprocal()


class _LeftStretch(NamedTuple):
    """V and b, the principal invariants of V, about the first invariant of sqrt(V), and which V are far from I."""

    v: Matrices
    b: Matrices
    invariants: tuple[Scalars, Scalars, Scalars]
    x1_guess: Scalars
    far: ParticleMask


def _left_stretch(deformation: Matrices) -> _LeftStretch:
    f = deformation.double()
    minors = cofactors(f)
    v3 = (f[0] * minors[0]).sum(0)
    # from the minors of F and not from b, which would cancel digits when stretches are very different
    b, adjugate_b = matmul(f, transpose(f)), matmul(minors, transpose(minors))
    b1, b2 = trace(b), trace(adjugate_b)
    eigenvalues = _approximate_eigenvalues(b1.detach(), b2.detach(), v3.detach().square())
    roots = eigenvalues.sqrt()
    v1, v2 = _root_invariants(b1, b2, v3, roots.sum(0))
    scale = (v1 * v2 - v3).reciprocal()
    of_i, of_b = (v2.square() - v1 * v3) * scale, v2 * scale
    v = torch.addcmul(identity_like(b) * of_i, of_b, b) - scale * adjugate_b
    far = (roots.amin(0) < LEAST_STRETCH) | (roots.amax(0) > MOST_STRETCH)
    return _LeftStretch(v, b, (v1, v2, v3), roots.sqrt().sum(0), far)


def _log_of_left_stretch(found: _LeftStretch, precision: torch.dtype) -> Matrices:
    """log V for stretches from LEAST_STRETCH to MOST_STRETCH.

    With X = sqrt(V) and Y = X - I:  log V = 2 log X = 2 int_0^1 Y (I + t Y)^-1 dt. The integral is taken by
    Gauss-Legendre quadrature and the inverse by Cayley-Hamilton, so that h is a combination of I, V and b whose
    coefficients need only the invariants.
    """
    v1, v2, v3 = found.invariants

    # X = x_i I + x_v V - x_b b, as V from b; Y = X - I, Y^2 = V - 2 X + I
    x3 = v3.sqrt()
    x1, x2 = _root_invariants(v1, v2, x3, found.x1_guess)
    x_b = (x1 * x2 - x3).reciprocal()
    x_i, x_v = x1 * x3 * x_b, (x1.square() - x2) * x_b

    # log X = y_i I + y_1 Y + y_2 Y^2
    i1, i2, i3 = x1 - 3.0, x2 - 2.0 * x1 + 3.0, x3 - x2 + x1 - 1.0
    s0, s1, s2 = _moments_of_inverse_determinant(i1, i2, i3, precision)
    y_1, along_x = s0 + i1 * s1, s0 + (i1 + 2.0) * s1
    of_i = i3 * s2 - y_1 - s1 + along_x * x_i
    of_v = along_x * x_v - s1
    log_v = torch.addcmul(identity_like(found.v) * (2.0 * of_i), 2.0 * of_v, found.v) - (2.0 * along_x * x_b) * found.b
    return log_v.to(precision)


def _where(mask: ParticleMask) -> Tensor | None:
    """The numbers of particles, None for none; none on a GPU, which would wait for the look."""
    if mask.is_cuda:
        return None
    return mask.nonzero()[:, 0] if bool(mask.any()) else None


def _identity_where(mask: ParticleMask, deformation: Matrices) -> Matrices:
    """F, but I where it would poison derivatives."""
    return torch.where(mask, identity_like(deformation), deformation)


def _root_invariants(a1: Scalars, a2: Scalars, x3: Scalars, x1: Scalars) -> tuple[Scalars, Scalars]:
    """First two principal invariants of X = sqrt(A) from those of A, det X and a guess of the first one.

    They solve x1^2 = a1 + 2 x2, x2^2 = a2 + 2 x1 x3. The guess is off by the square root of machine precision
    at worst, where two eigenvalues coincide, and not differentiable there; two Newton steps make it exact. Only
    the last step is differentiated, which gives the exact first derivative: that of a Newton step with respect
    to its starting point is zero at the solution.
    """
    x1 = _newton_step(x1, a1.detach(), a2.detach(), x3.detach())
    x1 = _newton_step(x1, a1, a2, x3)
    return x1, (a2 + 2.0 * x1 * x3).sqrt()


def _newton_step(x1: Scalars, a1: Scalars, a2: Scalars, x3: Scalars) -> Scalars:
    x2 = (a2 + 2.0 * x1 * x3).sqrt()
    return x1 - (x1.square() - a1 - 2.0 * x2) * x2 / (2.0 * (x1 * x2 - x3))


def _approximate_eigenvalues(a1: Scalars, a2: Scalars, a3: Scalars) -> Tensor:
    """Eigenvalues of a symmetric positive definite matrix from its invariants, (3, particles), approximately."""
    mean = a1 / 3.0
    radius = torch.maximum((mean.square() - a2 / 3.0).clamp_min(0.0).sqrt(), mean * torch.finfo(a1.dtype).eps)
    half_determinant = 0.5 * (a3 - mean * (a2 - 2.0 * mean.square())) / radius.pow(3)
    angle = half_determinant.clamp(-1.0, 1.0).acos() / 3.0
    thirds = torch.arange(0, 6, 2, dtype=a1.dtype, device=a1.device)[:, None] * (math.pi / 3.0)
    return (mean + 2.0 * radius * torch.cos(angle + thirds)).clamp_min(0.0)
