"""Elasticity with a stored energy: strain cycles return their work, rest is free of stress, kernels do the same."""

import pytest
import torch
from bodies import per_particle, seeded, uniform
from torch import Tensor

import pcnclaws as pc
from pcnclaws.compiled.backend import using_backend
from pcnclaws.laws.elasticity import StVKHencky
from pcnclaws.laws.materials import material_named
from pcnclaws.laws.neural_energy import EnergyNet

COUNT = 40


@pytest.fixture
def law() -> EnergyNet:
    """With amounts as a training might leave them."""
    made = _untrained()
    with torch.no_grad():
        made.amounts.weight.copy_(0.05 * uniform(seeded(0), *made.amounts.weight.shape))
    return made


def _untrained() -> EnergyNet:
    return EnergyNet(material_named("elasticity"), 8).double()


def _parameters(count: int = COUNT) -> dict[str, Tensor]:
    return per_particle({"youngs_modulus": 2e5, "poissons_ratio": 0.3}, count)


def _deformations(size: float, seed: int = 2) -> Tensor:
    return torch.matrix_exp(size * uniform(seeded(seed), COUNT, 3, 3)).permute(1, 2, 0).contiguous()


def test_an_untrained_law_is_henckys(law: EnergyNet) -> None:
    f, parameters = _deformations(0.3), _parameters()
    torch.testing.assert_close(_untrained()(f, parameters), StVKHencky()(f, parameters), rtol=1e-12, atol=1e-6)
    assert (law(f, parameters) - StVKHencky()(f, parameters)).abs().max() > 1e3


def test_rest_is_free_of_stress_and_young_and_poisson_are_the_moduli_there(law: EnergyNet) -> None:
    assert law(torch.eye(3).double()[:, :, None], _parameters(1)).abs().max() == 0.0
    f = _deformations(1e-6)
    torch.testing.assert_close(law(f, _parameters()), StVKHencky()(f, _parameters()), rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("size", [0.2, 0.8, 2.0])
def test_a_closed_strain_cycle_returns_its_work(law: EnergyNet, size: float) -> None:
    """Round a circle in principal Hencky strains, by the trapezoidal rule, which is exact to rounding on circles."""
    angle = torch.linspace(0.0, 2.0 * torch.pi, 1601, dtype=torch.float64)[:-1]
    first, second = (size * torch.tensor(one).double()[:, None] for one in ((0.7, -0.3, 0.1), (-0.2, 0.5, -0.6)))
    centre = 0.3 * size * torch.tensor((1.0, -1.0, 0.2)).double()[:, None]
    h = centre + first * angle.cos() + second * angle.sin()
    rate = second * angle.cos() - first * angle.sin()
    f = torch.diag_embed(h.T.exp()).permute(1, 2, 0)
    parameters = _parameters(len(angle))
    with torch.no_grad():
        work = (law(f, parameters).diagonal(dim1=0, dim2=1).T * rate).sum(0)
        energy = law.energy_density(f, parameters)
    tolerance = (
        1e-11 if size < -float(law.limits[:, 0].max()) / 2 else 1e-4
    )  # where the functions end there is a kink in the tangent
    assert abs(float(work.mean())) * 2.0 * torch.pi < tolerance * float(energy.abs().max())


def test_stress_is_the_derivative_of_the_energy(law: EnergyNet) -> None:
    f = _deformations(0.5).requires_grad_()
    (p,) = torch.autograd.grad(law.energy_density(f, _parameters()).sum(), f)
    tau = torch.einsum("ijn,kjn->ikn", p, f.detach())
    torch.testing.assert_close(law(f.detach(), _parameters()), tau, rtol=1e-9, atol=1e-4)


def test_a_law_goes_on_along_its_tangent_beyond_the_strains_that_it_has_seen(law: EnergyNet) -> None:
    law.see(torch.matrix_exp(0.1 * uniform(seeded(7), 4000, 3, 3)).permute(1, 2, 0))
    (low, high), *_ = law.limits.tolist()
    assert -0.3 < low < -0.1
    assert 0.1 < high < 0.3
    far = torch.linspace(0.4, 2.0, 9, dtype=torch.float64)

    def tension(h: Tensor) -> Tensor:
        strains = torch.stack((h, -0.5 * h, -0.5 * h))  # of constant volume
        return law(torch.diag_embed(strains.T.exp()).permute(1, 2, 0), _parameters(len(h)))[0, 0]

    stiffness = tension(far).diff()
    torch.testing.assert_close(stiffness, stiffness[:1].expand(8), rtol=1e-9, atol=0.0)
    assert stiffness[0] > 0.0


def test_no_weights_make_a_body_much_stiffer_or_let_its_energy_fall_far(law: EnergyNet) -> None:
    with torch.no_grad():
        law.amounts.weight.mul_(1e6)
    f = _deformations(0.5)
    energy, hencky = law.energy_density(f, _parameters()), StVKHencky().energy_density(f, _parameters())
    assert (energy < 40.0 * hencky).all()
    assert (energy > -0.5 * hencky).all()


def test_energy_and_stress_grow_without_bound_where_the_volume_vanishes(law: EnergyNet) -> None:
    sides = torch.tensor([1e-2, 1e-4, 1e-8, 1e-16]).double()
    f = torch.diag_embed(sides[:, None].expand(-1, 3)).permute(1, 2, 0)
    energy, stress = law.energy_density(f, _parameters(4)), law(f, _parameters(4))[0, 0]
    assert (energy.diff() > 0.0).all()
    assert (stress.diff() < 0.0).all()
    assert (stress < 0.0).all()


def test_gradients_of_kernels_reach_the_weights(law: EnergyNet) -> None:
    f, incoming, found = _deformations(0.3), uniform(seeded(5), 3, 3, COUNT), []
    for backend in ("torch", "compiled"):
        with using_backend(backend):
            found.append(torch.autograd.grad((law(f, _parameters()) * incoming).sum(), list(law.parameters())))
    for kernel, reference in zip(*found[::-1], strict=True):
        torch.testing.assert_close(kernel, reference, rtol=1e-8, atol=1e-8 * float(reference.abs().max()) + 1e-12)


def test_a_bouncing_body_keeps_its_energy() -> None:
    made = pc.neural_law("elasticity", network="pcnclaws_energy")
    body = pc.Body.cube(side=0.2, centre=(0.5, 0.3, 0.5), particles_per_edge=6)
    scene = pc.Scene(body, made, velocity=(0, -10.0, 0), settings=pc.Settings(time_step="auto"))
    motion = scene.simulate(150, 5)
    kinetic = 0.5 * motion.velocity.square().sum(2).mean(1) + 9.8 * motion.position[:, :, 1].mean(1)
    assert kinetic.max() < 1.01 * kinetic[0]
