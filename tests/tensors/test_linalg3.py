"""The batched 3x3 algebra against NumPy and SciPy, and its derivatives where stretches coincide."""

from collections.abc import Callable

import numpy as np
import pytest
import scipy.linalg
import torch
from bodies import seeded, uniform
from torch import Tensor

from pcnclaws.tensors.linalg3 import (
    cofactors,
    determinant,
    deviator,
    exp_symmetric,
    hencky_strain,
    inverse,
    left_stretch,
    matmul,
    safe_norm,
    trace,
    transpose,
)

# PyTorch warns of its own use of torch.jit when it loads forward mode
pytestmark = pytest.mark.filterwarnings("ignore:`torch.jit.script` is deprecated:DeprecationWarning")

SMALLEST, LARGEST = 0.05, 20.0


def rotations(generator: torch.Generator, count: int) -> Tensor:
    """Random rotations, (3, 3, count)."""
    q, _ = torch.linalg.qr(torch.randn(count, 3, 3, generator=generator, dtype=torch.float64))
    return (q * torch.det(q)[:, None, None]).permute(1, 2, 0)


def with_stretches(stretches: Tensor, generator: torch.Generator) -> Tensor:
    """Deformations U diag(stretches) V^T with random rotations, (3, 3, count) from (3, count)."""
    count = stretches.shape[1]
    left, right = rotations(generator, count), rotations(generator, count)
    return matmul(left * stretches, transpose(right))


def far_stretches(generator: torch.Generator, count: int) -> Tensor:
    """Log-uniform over the whole range, the extremes included."""
    logs = uniform(generator, 3, count, low=np.log(SMALLEST), high=np.log(LARGEST))
    extremes = torch.tensor([SMALLEST, 1.0, LARGEST], dtype=torch.float64).log()
    corners = torch.cartesian_prod(extremes, extremes, extremes).T
    return torch.cat((logs, corners), dim=1).exp()


def coinciding_stretches(generator: torch.Generator, count: int) -> Tensor:
    """Two or three equal stretches, and pairs that differ by 1e-2 to 1e-15."""
    base = uniform(generator, 3, count, low=-1.5, high=1.5).exp()
    two, three = base.clone(), base[:1].expand(3, -1).clone()
    two[1] = two[0]
    near = two.clone()
    near[1] *= 1.0 + 10.0 ** uniform(generator, count, low=-15, high=-2)
    all_near = three * (1.0 + 10.0 ** uniform(generator, 3, count, low=-15, high=-2))
    return torch.cat((two, three, near, all_near), dim=1)


def numpy_hencky(deformation: Tensor) -> Tensor:
    """log of the left stretch by singular values, in float64."""
    left, stretches, _ = np.linalg.svd(deformation.double().permute(2, 0, 1).numpy())
    strain = np.einsum("pij,pj,pkj->pik", left, np.log(stretches), left)
    return torch.from_numpy(strain).permute(1, 2, 0)


FAMILIES: dict[str, Callable[[torch.Generator, int], Tensor]] = {
    "far": far_stretches,
    "coinciding": coinciding_stretches,
    "nearly none": lambda generator, count: 1.0 + 1e-7 * uniform(generator, 3, count),
    "none": lambda generator, count: torch.ones(3, count, dtype=torch.float64),
}


@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float64, 1e-12), (torch.float32, 1e-6)])
@pytest.mark.parametrize("family", FAMILIES)
def test_hencky_strain_is_the_logarithm_of_the_stretch(family: str, dtype: torch.dtype, tolerance: float) -> None:
    generator = seeded(0)
    deformation = with_stretches(FAMILIES[family](generator, 2000), generator).to(dtype)
    strain = hencky_strain(deformation)
    assert strain.dtype == dtype
    torch.testing.assert_close(strain.double(), numpy_hencky(deformation), rtol=0, atol=tolerance)


def test_hencky_strain_of_the_identity_is_exactly_zero_or_rounding() -> None:
    strain = hencky_strain(torch.eye(3, dtype=torch.float64)[:, :, None])
    assert strain.abs().max() <= 1e-15


def test_left_stretch_is_the_root_of_the_left_cauchy_green_tensor() -> None:
    generator = seeded(1)
    deformation = with_stretches(coinciding_stretches(generator, 200), generator)
    v, b = left_stretch(deformation)
    torch.testing.assert_close(b, matmul(deformation, transpose(deformation)), rtol=1e-12, atol=1e-13)
    torch.testing.assert_close(matmul(v, v), b, rtol=1e-12, atol=1e-13)
    assert (torch.linalg.eigvalsh(v.permute(2, 0, 1)) > 0).all()


@pytest.mark.parametrize("size", [0.0, 1e-8, 0.1, 1.0, 2.0])
def test_exponential_agrees_with_scipy(size: float) -> None:
    general = size * uniform(seeded(2), 3, 3, 300)
    symmetric = 0.5 * (general + transpose(general))
    expected = scipy.linalg.expm(symmetric.permute(2, 0, 1).numpy())
    actual = exp_symmetric(symmetric).permute(2, 0, 1).numpy()
    scale = np.abs(expected).max((1, 2), keepdims=True)
    np.testing.assert_allclose(actual / scale, expected / scale, rtol=0, atol=1e-12)


def test_exponential_undoes_the_logarithm() -> None:
    generator = seeded(3)
    stretches = uniform(generator, 3, 200, low=-1.0, high=1.0).exp()
    deformation = with_stretches(stretches, generator)
    restored = exp_symmetric(hencky_strain(deformation))
    torch.testing.assert_close(restored, left_stretch(deformation)[0], rtol=0, atol=1e-12)


def test_exponential_of_zero_is_exactly_the_identity() -> None:
    zero = torch.zeros(3, 3, 4)
    assert torch.equal(exp_symmetric(zero), torch.eye(3)[:, :, None].expand(3, 3, 4))


def test_products_determinants_and_inverses_agree_with_torch() -> None:
    generator = seeded(4)
    a, b = uniform(generator, 3, 3, 50), uniform(generator, 3, 3, 50)
    a_first, b_first = a.permute(2, 0, 1), b.permute(2, 0, 1)
    torch.testing.assert_close(matmul(a, b).permute(2, 0, 1), a_first @ b_first)
    torch.testing.assert_close(determinant(a), torch.det(a_first))
    torch.testing.assert_close(inverse(a).permute(2, 0, 1), torch.linalg.inv(a_first))
    torch.testing.assert_close(cofactors(a), transpose(inverse(a)) * determinant(a))
    torch.testing.assert_close(trace(deviator(a)), torch.zeros(50, dtype=torch.float64))
    torch.testing.assert_close(safe_norm(a), torch.linalg.matrix_norm(a_first))


def test_norm_has_a_finite_derivative_at_zero() -> None:
    zero = torch.zeros(3, 3, 1, requires_grad=True)
    (gradient,) = torch.autograd.grad(safe_norm(zero).sum(), zero)
    assert torch.equal(gradient, torch.zeros(3, 3, 1))


FUNCTIONS: dict[str, Callable[[Tensor], Tensor]] = {
    "hencky_strain": hencky_strain,
    "left_stretch": lambda deformation: left_stretch(deformation)[0].to(deformation),
    "exp of hencky_strain": lambda deformation: exp_symmetric(hencky_strain(deformation)),
    "exp_symmetric": lambda a: exp_symmetric(0.5 * (a + transpose(a))),
}


def coinciding_deformations() -> Tensor:
    """F = I, a rotation, a dilation, two equal stretches, two nearly equal ones, three different ones."""
    generator = seeded(5)
    stretches = torch.tensor(
        [[1, 1, 1], [1, 1, 1], [1.3, 1.3, 1.3], [0.7, 0.7, 1.4], [0.7, 0.7 + 1e-9, 1.4], [0.4, 1.1, 2.0]],
        dtype=torch.float64,
    ).T
    deformation = with_stretches(stretches, generator)
    deformation[:, :, 0] = torch.eye(3)
    return deformation


@pytest.mark.parametrize("name", FUNCTIONS)
def test_derivatives_are_right_where_stretches_coincide(name: str) -> None:
    deformation = coinciding_deformations().requires_grad_()
    assert torch.autograd.gradcheck(FUNCTIONS[name], deformation, eps=1e-5, atol=1e-7, rtol=1e-6)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("name", FUNCTIONS)
def test_forward_mode_agrees_with_reverse_mode(name: str, dtype: torch.dtype) -> None:
    generator = seeded(6)
    function, deformation = FUNCTIONS[name], coinciding_deformations().to(dtype)
    tangent, cotangent = (uniform(generator, 3, 3, deformation.shape[2]).to(dtype) for _ in range(2))
    forward = torch.func.jvp(function, (deformation,), (tangent,))[1]
    (reverse,) = torch.func.vjp(function, deformation)[1](cotangent)
    tolerance = 1e-11 if dtype == torch.float64 else 1e-5
    torch.testing.assert_close((forward * cotangent).sum(), (reverse * tangent).sum(), rtol=tolerance, atol=tolerance)


def test_derivative_of_the_strain_at_rest_is_the_symmetric_part() -> None:
    generator = seeded(8)
    at_rest = torch.eye(3, dtype=torch.float64)[:, :, None].repeat(1, 1, 5)
    change = uniform(generator, 3, 3, 5)
    tangent = torch.func.jvp(hencky_strain, (at_rest,), (change,))[1]
    torch.testing.assert_close(tangent, 0.5 * (change + transpose(change)), rtol=0, atol=1e-12)


def test_gradients_are_finite_over_the_whole_range_in_single_precision() -> None:
    generator = seeded(9)
    stretches = torch.cat([family(generator, 500) for family in FAMILIES.values()], dim=1)
    deformation = with_stretches(stretches, generator).float().requires_grad_()
    (gradient,) = torch.autograd.grad(hencky_strain(deformation).square().sum(), deformation)
    assert torch.isfinite(gradient).all()
