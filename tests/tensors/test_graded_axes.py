"""Stress and plastic flow of deformations of any scale: kernels, PyTorch and exact arithmetic agree."""

from fractions import Fraction

import mpmath
import pytest
import torch
from bodies import per_particle, seeded, uniform
from compiled_checks import MATERIALS, laws_of
from graded_deformations import FAMILIES, LEAST, MOST, graded
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from pcnclaws.compiled import gpu
from pcnclaws.compiled.backend import using_backend
from pcnclaws.compiled.build import find_compiler
from pcnclaws.compiled.isotropic_laws import fallbacks
from pcnclaws.compiled.structures import LawArrays
from pcnclaws.laws.base import Elasticity
from pcnclaws.laws.elasticity import FixedCorotated, StVKHencky
from pcnclaws.laws.law import Law
from pcnclaws.laws.materials import material_named
from pcnclaws.laws.plasticity import DruckerPrager, VonMises
from pcnclaws.tensors.linalg3 import hencky_strain

pytestmark = pytest.mark.skipif(find_compiler() is None, reason="needs a C++ compiler")
TOLERANCES = {torch.float32: 1e-5, torch.float64: 1e-11}
PRECISIONS = pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
FAMILY = pytest.mark.parametrize("family", FAMILIES)
ON_GPU = [pytest.mark.gpu, pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")]
DEVICES = pytest.mark.parametrize("device", ["cpu", pytest.param("cuda", marks=ON_GPU)])


def test_an_almost_undeformed_particle_has_almost_no_stress() -> None:
    """Squares of these entries vanish in single precision; a rotation by them was none, and the stress -1.1e8 Pa."""
    f = torch.eye(3)[:, :, None].clone()
    f[1, 1] = 0.9999999403953552
    f[0, 1], f[1, 0] = -3.196208624458925e-26, -3.196606136399447e-26
    f[0, 2], f[2, 0] = 1.4467986680791994e-22, -1.5046140944962301e-22
    f[1, 2], f[2, 1] = 1.5864595193093578e-09, -1.5834977773465653e-09
    parameters = {"youngs_modulus": torch.tensor([4e5]), "poissons_ratio": torch.tensor([0.25])}
    stress = StVKHencky()(f, parameters)
    with using_backend("torch"):
        torch.testing.assert_close(stress, StVKHencky()(f, parameters), rtol=0, atol=1e-3)
    assert stress.abs().max() < 0.1


@FAMILY
@PRECISIONS
def test_kernels_and_pytorch_agree(family: str, dtype: torch.dtype) -> None:
    f = graded(family, 300).to(dtype)
    for law, material in _laws():
        assert _difference(law, material, f) < TOLERANCES[dtype], type(law).__name__


@pytest.mark.slow
@FAMILY
@PRECISIONS
def test_a_million_kernels_and_pytorch_agree(family: str, dtype: torch.dtype) -> None:
    for chunk in range(5):
        f = graded(family, 20_000, seed=chunk).to(dtype)
        for law, material in _laws():
            assert _difference(law, material, f) < TOLERANCES[dtype], type(law).__name__


NUMBERS = st.one_of(
    st.just(0.0), st.builds(lambda sign, power: sign * 10.0**power, st.sampled_from((-1, 1)), st.floats(LEAST, MOST))
)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.lists(NUMBERS, min_size=9, max_size=9), st.booleans())
def test_any_entries(entries: list[float], beside_identity: bool) -> None:
    f = torch.tensor(entries).view(3, 3, 1) + (torch.eye(3)[:, :, None] if beside_identity else 0.0)
    if _exact_determinant(f) <= 0:
        return
    for law, material in ((StVKHencky(), "sand"), (DruckerPrager(), "sand")):
        assert _difference(law, material, f) < TOLERANCES[torch.float32]


@FAMILY
def test_logarithms_are_those_of_exact_arithmetic(family: str) -> None:
    f = graded(family, 25, seed=1)
    # mu = 1/2 and lambda = 0: the stress is the Hencky strain
    parameters = per_particle({"youngs_modulus": 1.0, "poissons_ratio": 0.0}, f.shape[2])
    expected = torch.stack([_exact_strain(f[:, :, n]) for n in range(f.shape[2])], dim=2)
    size = expected.abs().amax((0, 1)).clamp_min(1.0)
    for found in (hencky_strain(f), StVKHencky()(f, parameters)):
        assert ((found - expected).abs() / size).max() < 1e-11


@pytest.mark.parametrize(
    "shear", [(-1.1264e15, -3.4713e17, 1.8458e16), (-1.4135e15, 9.2794e16, 1.1182e15), (8.3583e12, -1.0267e13, -6.2e12)]
)
def test_minors_that_cancel_keep_their_digits(shear: tuple[float, float, float]) -> None:
    """Elimination leaves 1e-14 of numbers that differ by as much: it lost the smallest stretch by 1e-3."""
    f = torch.eye(3, dtype=torch.float64)[:, :, None].clone()
    f[0, 1], f[0, 2], f[1, 2] = torch.tensor(shear).float().double()[:, None]
    parameters = per_particle({"youngs_modulus": 1.0, "poissons_ratio": 0.0}, 1)
    expected = _exact_strain(f[:, :, 0])
    for found in (hencky_strain(f), StVKHencky()(f, parameters)):
        torch.testing.assert_close(found[:, :, 0], expected, rtol=0.0, atol=1e-12)


@FAMILY
def test_gradients_agree(family: str) -> None:
    """Where stretches lie within the range of bodies: beyond, gradients leave the range of numbers."""
    f = graded(family, 2000, seed=2)
    stretches = torch.linalg.svdvals(f.permute(2, 0, 1))
    f = f[:, :, (stretches[:, 2] > 1e-3) & (stretches[:, 0] < 1e3)]
    incoming = uniform(seeded(3), *f.shape)
    for law, material in ((StVKHencky(), "sand"), (FixedCorotated(), "elasticity"), (VonMises(), "plasticine")):
        parameters = per_particle(material_named(material).defaults, f.shape[2])
        found = []
        for backend in ("torch", "compiled"):
            with using_backend(backend):
                inputs = f.clone().requires_grad_()
                found.append(torch.autograd.grad(law(inputs, parameters), inputs, incoming)[0])
        size = found[0].abs().amax((0, 1)).clamp_min(1.0)
        assert ((found[1] - found[0]).abs() / size).max() < 1e-6


def test_the_slow_path_is_counted_and_left_to_what_is_far_from_one() -> None:
    parameters = per_particle({"youngs_modulus": 1.0, "poissons_ratio": 0.0}, 10, torch.float32)
    f = torch.eye(3)[:, :, None].repeat(1, 1, 10)
    f[0, 1, 1:5] = torch.tensor([1e-45, -1e-26, 1e-18, 1e-7])
    f[0, 0, 5:8] = torch.tensor([0.02, 50.0, 1.0 + 1e-6])
    before = fallbacks()
    StVKHencky()(f, parameters)
    assert fallbacks() == before
    f[1, 1, 9], f[2, 2, 3] = 1e-5, 1e6
    StVKHencky()(f, parameters)
    assert fallbacks() == before + 2


@DEVICES
@FAMILY
@PRECISIONS
def test_kernels_for_gpus_agree(family: str, dtype: torch.dtype, device: str) -> None:
    f = graded(family, 60 if device == "cpu" else 20_000).to(dtype)
    for law in (StVKHencky(), DruckerPrager()):
        assert law.kernel is not None
        parameters = per_particle(material_named("sand").defaults, f.shape[2], dtype)
        rows = law.kernel_rows(parameters).contiguous()
        found = gpu.law_forward(law.kernel, LawArrays(f.to(device), rows.to(device)))[0].cpu()
        assert _largest_error(law, f, found, law(f, parameters), 3e5) < TOLERANCES[dtype]


def _laws() -> list[tuple[Law, str]]:
    named = [(law, material) for material in MATERIALS for law in laws_of(material, "analytic")[:2] if law is not None]
    named += [(law, "plasticine") for law in laws_of("plasticine", "neural")[:2] if law is not None]
    return list({type(law): (law, material) for law, material in named}.values())


@torch.no_grad()
def _difference(law: Law, material: str, f: Tensor) -> float:
    """Between kernel and PyTorch: see _largest_error."""
    values = material_named(material).defaults
    parameters = per_particle(values, f.shape[2], f.dtype)
    law = law.to(f.dtype)
    compiled = law(f, parameters)
    with using_backend("torch"):
        return _largest_error(law, f, compiled, law(f, parameters), values["youngs_modulus"])


def _largest_error(law: Law, f: Tensor, found: Tensor, expected: Tensor, youngs_modulus: float) -> float:
    """Of stresses relative to E, of deformations relative to the largest strain; or to the result if it is larger.

    A plastic law of PyTorch keeps the strain in the precision of F, whose rounding is a factor of what it returns.
    """
    # stresses that single precision does not hold are infinite in both
    held = expected.isfinite().all(0).all(0)
    assert torch.equal(found.isfinite().all(0).all(0), held)
    assert not expected.isnan().all(0).all(0).any()
    size = expected.abs().amax((0, 1)).clamp_min(youngs_modulus if isinstance(law, Elasticity) else 1.0)
    if not isinstance(law, Elasticity):
        size = size * hencky_strain(f).abs().amax((0, 1)).clamp_min(1.0)
    return float(((found - expected).abs().amax((0, 1)) / size)[held].max()) if held.any() else 0.0


def _exact_determinant(f: Tensor) -> Fraction:
    (a, b, c), (d, e, g), (h, i, j) = ([Fraction(float(f[row, column, 0])) for column in range(3)] for row in range(3))
    return a * (e * j - g * i) - b * (d * j - g * h) + c * (d * i - e * h)


def _exact_strain(f: Tensor) -> Tensor:
    """1/2 log(F F^T) in 220 digits, (3, 3)."""
    with mpmath.workdps(220):
        matrix = mpmath.matrix(f.tolist())
        squares, axes = mpmath.eigsy(matrix * matrix.T)
        strain = axes * mpmath.diag([mpmath.log(square) / 2 for square in squares]) * axes.T
        return torch.tensor([[float(strain[i, j]) for j in range(3)] for i in range(3)], dtype=torch.float64)
