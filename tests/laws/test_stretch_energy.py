"""The convex energy of the principal stretches: no stress at rest, stress that grows with strain, kernels alike."""

from collections.abc import Iterator

import pytest
import torch
from bodies import per_particle, seeded, uniform
from torch import Tensor

from pcnclaws.compiled.backend import using_backend
from pcnclaws.laws.elasticity import StVKHencky
from pcnclaws.laws.materials import material_named
from pcnclaws.laws.principal import strains
from pcnclaws.laws.stretch_energy import StretchEnergyNet

COUNT = 40


@pytest.fixture(autouse=True)
def _in_pytorch() -> Iterator[None]:
    """Its kernel takes long to compile."""
    with using_backend("torch"):
        yield


@pytest.fixture
def law() -> StretchEnergyNet:
    """With amounts, a shape and a reach as a training might leave them."""
    made = StretchEnergyNet(material_named("elasticity"), 8).double()
    with torch.no_grad():
        made.amounts.weights[-1].copy_(uniform(seeded(0), *made.amounts.weights[-1].shape))
        made.amounts.biases[-1].copy_(2.0 * uniform(seeded(1), *made.amounts.biases[-1].shape))
        made.shape.copy_(torch.tensor([[0.5], [-0.4]]))
        made.scale.fill_(-0.5)
        made.reach.copy_(torch.tensor([-0.8, 1.1]))
    return made


def _parameters(count: int = COUNT) -> dict[str, Tensor]:
    return per_particle({"youngs_modulus": 2e5, "poissons_ratio": 0.3}, count)


def _deformations(size: float, seed: int = 2) -> Tensor:
    return torch.matrix_exp(size * uniform(seeded(seed), COUNT, 3, 3)).permute(1, 2, 0).contiguous()


def test_rest_is_free_of_stress_and_young_and_poisson_are_the_moduli_there(law: StretchEnergyNet) -> None:
    assert law(torch.eye(3).double()[:, :, None], _parameters(1)).abs().max() < 1e-9
    f = _deformations(1e-6)
    torch.testing.assert_close(law(f, _parameters()), StVKHencky()(f, _parameters()), rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("size", [0.3, 1.0])
def test_stress_is_the_derivative_of_the_energy_within_and_beyond_the_reach(law: StretchEnergyNet, size: float) -> None:
    f = _deformations(size).requires_grad_()
    (p,) = torch.autograd.grad(law.energy_density(f, _parameters()).sum(), f)
    tau = torch.einsum("ijn,kjn->ikn", p, f.detach())
    torch.testing.assert_close(law(f.detach(), _parameters()), tau, rtol=1e-8, atol=1e-3)


def test_stress_grows_with_strain_between_any_two_states(law: StretchEnergyNet) -> None:
    """Hill's inequality (tau_1 - tau_2) . (h_1 - h_2) > 0, which convexity of the energy in h is."""
    h = 3.0 * uniform(seeded(3), 2, 3, 500)
    with torch.no_grad():
        first, second = (law.response(_parameters(500))(one) for one in h)
    work = ((first - second) * (h[0] - h[1])).sum(0)
    assert (work > 0.0).all()


def test_no_strain_however_large_makes_the_stress_infinite(law: StretchEnergyNet) -> None:
    sides = torch.tensor([1e-6, 0.1, 10.0, 1e3]).double()
    f = torch.diag_embed(torch.stack((sides, 1.0 / sides.sqrt(), 1.0 / sides.sqrt()), 1)).permute(1, 2, 0)
    stress = law(f, _parameters(4))
    assert torch.isfinite(stress).all()
    assert (stress[0, 0].diff() > 0.0).all()
    assert float(strains(f).abs().max()) > 10.0


@pytest.mark.slow
def test_gradients_of_kernels_reach_the_weights(law: StretchEnergyNet) -> None:
    f, incoming, found = _deformations(0.3), uniform(seeded(5), 3, 3, COUNT), []
    for backend in ("torch", "compiled"):
        with using_backend(backend):
            found.append(torch.autograd.grad((law(f, _parameters()) * incoming).sum(), list(law.parameters())))
    for kernel, reference in zip(*found[::-1], strict=True):
        torch.testing.assert_close(kernel, reference, rtol=1e-7, atol=1e-8 * float(reference.abs().max()) + 1e-12)
