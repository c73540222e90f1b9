"""What every constitutive law must obey, whether it is written down or learned."""

from collections.abc import Mapping

import torch
from bodies import per_particle, seeded, uniform
from torch import Tensor

from pcnclaws.laws.base import Elasticity, Plasticity
from pcnclaws.laws.moduli import lame_constants
from pcnclaws.tensors.linalg3 import exp_symmetric, hencky_strain, identity_like, matmul, trace, transpose

COUNT = 100


def rotations(seed: int, count: int = COUNT) -> Tensor:
    """Random rotations, (3, 3, count)."""
    q, _ = torch.linalg.qr(torch.randn(count, 3, 3, generator=seeded(seed), dtype=torch.float64))
    return (q * torch.det(q)[:, None, None]).permute(1, 2, 0)


def strains(seed: int, size: float, count: int = COUNT) -> Tensor:
    """Random symmetric matrices with entries up to `size`, (3, 3, count)."""
    general = size * uniform(seeded(seed), 3, 3, count)
    return 0.5 * (general + transpose(general))


def deformations(seed: int, size: float) -> Tensor:
    """Random deformations whose Hencky strain has entries up to `size`, with random rotations."""
    return matmul(exp_symmetric(strains(seed, size)), rotations(seed + 1))


def hencky_energy(deformation: Tensor, parameters: Mapping[str, Tensor]) -> Tensor:
    """Elastic energy density mu |h|^2 + lambda/2 tr(h)^2 [J/m^3], (particles,)."""
    lam, mu = lame_constants(parameters)
    h = hencky_strain(deformation)
    return mu * h.square().sum((0, 1)) + 0.5 * lam * trace(h).square()


def check_elasticity(
    elasticity: Elasticity, values: Mapping[str, float], keeps_moduli: bool = True, rounding: float = 1e-14
) -> None:
    """Rest, objectivity, isotropy, symmetry, finite derivatives at rest and, with `keeps_moduli`, Hooke's law."""
    parameters = per_particle(values, COUNT)
    lam, mu = lame_constants(parameters)
    unit = float(2.0 * mu[0] + 3.0 * lam[0].abs())

    def stress(deformation: Tensor) -> Tensor:
        return elasticity(deformation, parameters)

    turn = rotations(20)
    torch.testing.assert_close(stress(turn) / unit, torch.zeros_like(turn), rtol=0, atol=rounding)
    for size in (0.02, 0.3):
        f = deformations(21, size)
        tau = stress(f)
        torch.testing.assert_close(tau / unit, transpose(tau) / unit, rtol=0, atol=rounding)
        turned = matmul(matmul(turn, tau), transpose(turn))
        torch.testing.assert_close(stress(matmul(turn, f)) / unit, turned / unit, rtol=0, atol=100 * rounding)
        torch.testing.assert_close(stress(matmul(f, turn)) / unit, tau / unit, rtol=0, atol=100 * rounding)

    rest = identity_like(turn).repeat(1, 1, COUNT).requires_grad_()
    (gradient,) = torch.autograd.grad(stress(rest).square().sum() + stress(rest).sum(), rest)
    assert torch.isfinite(gradient).all()
    if keeps_moduli:
        small = strains(22, 1e-7)
        hooke = 2.0 * mu * small + identity_like(small) * (lam * trace(small))
        error = (stress(identity_like(small) + small) - hooke) / (unit * 1e-7)
        assert error.abs().max() < max(1e-5, 1e7 * rounding)


def check_plasticity(plasticity: Plasticity, values: Mapping[str, float], idempotent: bool = True) -> None:
    """Objectivity, isotropy, kept rotation, finite derivatives at rest, no energy gained and, if so, idempotence."""
    parameters = per_particle(values, COUNT)

    def returned(trial: Tensor) -> Tensor:
        return plasticity(trial, parameters)

    turn = rotations(30)
    torch.testing.assert_close(returned(turn), turn, rtol=0, atol=1e-14)
    for size in (0.002, 0.02, 0.3):
        f = deformations(31, size)
        elastic = returned(f)
        torch.testing.assert_close(returned(matmul(turn, f)), matmul(turn, elastic), rtol=0, atol=1e-12)
        torch.testing.assert_close(returned(matmul(f, turn)), matmul(elastic, turn), rtol=0, atol=1e-12)
        # the flow is a symmetric stretch, coaxial with the strain
        flow = matmul(elastic, torch.linalg.inv(f.permute(2, 0, 1)).permute(1, 2, 0))
        torch.testing.assert_close(flow, transpose(flow), rtol=0, atol=1e-12)
        before, after = hencky_energy(f, parameters), hencky_energy(elastic, parameters)
        assert (after <= before * (1.0 + 1e-12)).all()
        if idempotent:
            torch.testing.assert_close(returned(elastic), elastic, rtol=0, atol=1e-13)

    rest = identity_like(turn).repeat(1, 1, COUNT).requires_grad_()
    (gradient,) = torch.autograd.grad(returned(rest).square().sum(), rest)
    assert torch.isfinite(gradient).all()
