"""Learned convex elastic domains: the physics that no weights change, and the surfaces with corners that they hold."""

import math
from collections.abc import Mapping, Sequence

import pytest
import torch
from bodies import per_particle, seeded, uniform
from law_checks import COUNT, check_plasticity, deformations
from torch import Tensor

from benchmarks.foreign_materials import FOREIGN
from pcnclaws.compiled.backend import using_backend
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.materials import MATERIALS, Material
from pcnclaws.laws.neural_convex import (
    LIMITS,
    OTHER_COMPRESSIONS,
    REACH,
    UNTRAINED_COMPRESSION,
    UNTRAINED_SHARES,
    ConvexPlasticNet,
)
from pcnclaws.laws.yield_gauges import GAUGES, gauge, ordered

PLASTIC = ("sand", "tresca")


def stirred(material: Material, size: float, seed: int = 0) -> ConvexPlasticNet:
    """A law whose amounts are displaced at random."""
    law = ConvexPlasticNet(material, 8).double()
    with torch.no_grad():
        law.amounts.weight.copy_(size * torch.randn(law.amounts.weight.shape, generator=seeded(seed)))
    return law


def holding(
    material: Material, values: Mapping[str, float], shares: Sequence[float], normal: float
) -> ConvexPlasticNet:
    """A law with these coefficients at the middle of the material's ranges.

    values  the coefficients of LIMITS, as factors of what they are squares or exponentials of
    """
    law = ConvexPlasticNet(material, 8).double()
    with torch.no_grad():
        amounts = law.amounts.weight[:, 0]
        for k, name in enumerate(LIMITS):
            amounts[k] = values[name] / REACH
        for k, (share, start) in enumerate(zip(shares, UNTRAINED_SHARES, strict=True), len(LIMITS)):
            amounts[k] = (math.sqrt(share) - start) / REACH
        amounts[-1] = (math.asin(math.sqrt(normal)) - 0.25 * math.pi) / REACH
    return law


@pytest.mark.usefixtures("each_backend")
@pytest.mark.parametrize("size", [0.0, 0.1])
@pytest.mark.parametrize("name", PLASTIC)
def test_the_law_obeys_what_laws_must_and_a_second_return_finds_nothing_to_do(name: str, size: float) -> None:
    check_plasticity(stirred(MATERIALS[name], size), MATERIALS[name].defaults, idempotent=True)


@pytest.mark.parametrize("seed", range(3))
def test_plastic_work_is_never_negative(seed: int) -> None:
    """(h - h') : tau' >= 0 for Hencky's stress of what is left."""
    material = MATERIALS["sand"]
    parameters = per_particle(material.defaults, 4000)
    h = 0.05 * torch.randn(3, 4000, generator=seeded(seed), dtype=torch.float64)
    with torch.no_grad():
        after = stirred(material, 0.1, seed).response(parameters)(h)
    assert ((h - after) * (after - after.mean(0))).sum(0).min() >= -1e-17
    assert ((h - after).sum(0) * after.sum(0)).min() >= -1e-17


@pytest.mark.parametrize("seed", range(3))
def test_what_lies_between_admissible_strains_is_admissible(seed: int) -> None:
    material = MATERIALS["sand"]
    parameters, generator = per_particle(material.defaults, 4000), seeded(seed)
    returned = stirred(material, 0.05, seed).response(parameters)
    with torch.no_grad():
        one, other = (returned(0.05 * torch.randn(3, 4000, generator=generator).double()) for _ in range(2))
        between = one + uniform(generator, 4000, low=0.0) * (other - one)
        torch.testing.assert_close(returned(between), between, rtol=0, atol=1e-15)


@pytest.mark.parametrize("seed", range(3))
def test_gauges_are_convex_and_one_in_pure_shear(seed: int) -> None:
    generator = seeded(seed)
    shares = uniform(generator, len(GAUGES), 1, low=0.0)
    shares = list((shares / shares.sum(0)).unbind(0))

    def of(strain: Tensor) -> Tensor:
        return gauge(ordered((strain - strain.mean(0)).unbind(0)), shares)

    a, b = (torch.randn(3, 4000, generator=generator, dtype=torch.float64) for _ in range(2))
    assert (of(a + b) <= of(a) + of(b) + 1e-14).all()
    torch.testing.assert_close(of(2.5 * a), 2.5 * of(a), rtol=1e-14, atol=0)
    shear = torch.tensor((1.0, 0.0, -1.0)).double()[:, None] / math.sqrt(2.0)
    torch.testing.assert_close(of(shear), torch.ones(1).double(), rtol=1e-14, atol=0)


def _truth(name: str) -> tuple[ConvexPlasticNet, Material]:
    """The law that is one of another form, at the middle of that material's ranges."""
    material = FOREIGN[name]
    values = material.defaults
    unlimited = {"tension": 1e3, "compression": 20.0}
    if name == "tresca":
        amounts = {**unlimited, "cohesion": 0.0, "friction": -0.2}
        return holding(material, amounts, (0.5, 0.5, 0.0, 0.0, 0.0), normal=1.0), material
    sine = math.sin(math.radians(values["friction_angle"]))
    if name == "mohr_coulomb":
        amounts = {
            "tension": -1.0,
            "compression": 20.0,
            "cohesion": -1.0,
            "friction": math.sqrt(math.sqrt(2) * sine) - 0.5,
        }
        return holding(material, amounts, (0.5 + 0.5 * sine, 0.5 - 0.5 * sine, 0.0, 0.0, 0.0), normal=0.0), material
    # 3 K/(2 mu) alpha of the analytic law, over K/(2 mu)
    slope = 3.0 * math.sqrt(2.0 / 3.0) * 2.0 * sine / (3.0 - sine)
    cap = math.log(0.02 / UNTRAINED_COMPRESSION)
    amounts = {"tension": -1.0, "compression": cap, "cohesion": -1.0, "friction": math.sqrt(slope) - 0.5}
    return holding(material, amounts, (0.0, 0.0, 1.0, 0.0, 0.0), normal=0.0), material


@pytest.mark.usefixtures("each_backend")
@pytest.mark.parametrize("name", ["tresca", "mohr_coulomb", "cap"])
def test_laws_of_other_forms_are_among_its_own(name: str) -> None:
    law, material = _truth(name)
    plasticity = analytic_laws(material).plasticity
    assert plasticity is not None
    parameters = per_particle(material.defaults, COUNT)
    for size in (0.01, 0.1):
        f = deformations(17, size) * (0.99 if name != "tresca" else 1.0)
        torch.testing.assert_close(law(f, parameters), plasticity(f, parameters), rtol=0, atol=1e-9)


def test_alternatives_differ_in_the_bound_on_compression_alone_whatever_the_parameters() -> None:
    material = MATERIALS["sand"]
    law = stirred(material, 0.1)
    parameters = {name: torch.tensor(span).double() for name, span in material.ranges.items()}
    before, bounds = law.coefficients(parameters), []
    for weight in law.alternatives():
        with torch.no_grad():
            law.amounts.weight.copy_(weight)
        found = dict(law.coefficients(parameters))
        bounds.append(found.pop("compression"))
        assert all(torch.equal(value, before[name]) for name, value in found.items())
    wanted = torch.tensor((UNTRAINED_COMPRESSION, *OTHER_COMPRESSIONS), dtype=torch.float64)[:, None].expand(-1, 2)
    torch.testing.assert_close(torch.stack(bounds), wanted, rtol=1e-12, atol=0)


def test_kernels_and_pytorch_agree_on_the_gradients_also_where_stretches_meet() -> None:
    material = MATERIALS["tresca"]
    law, parameters = stirred(material, 0.03), per_particle(material.defaults, COUNT)
    f = deformations(3, 0.05)
    f[:, :, 0], f[:, :, 1] = torch.diag(torch.tensor([1.05, 1.05, 0.9])), torch.diag(torch.tensor([0.9, 0.9, 1.05]))
    incoming, found = uniform(seeded(5), 3, 3, COUNT), []
    for backend in ("torch", "compiled"):
        with using_backend(backend):
            inputs = [f.clone().requires_grad_(), *law.parameters()]
            found.append(torch.autograd.grad((law(inputs[0], parameters) * incoming).sum(), inputs))
    for kernel, reference in zip(*found[::-1], strict=True):
        torch.testing.assert_close(kernel, reference, rtol=1e-9, atol=1e-9 * float(reference.abs().max()))


def test_the_derivative_is_that_of_differences() -> None:
    material = MATERIALS["sand"]
    law, parameters = stirred(material, 0.03, 1), per_particle(material.defaults, COUNT)
    f, incoming = deformations(8, 0.05), uniform(seeded(6), 3, 3, COUNT)
    along = uniform(seeded(7), 3, 3, COUNT)
    at = f.clone().requires_grad_()
    (slope,) = torch.autograd.grad((law(at, parameters) * incoming).sum(), at)
    step = 1e-6
    with torch.no_grad():
        ends = [(law(f + sign * step * along, parameters) * incoming).sum((0, 1)) for sign in (1.0, -1.0)]
    difference = (ends[0] - ends[1]) / (2.0 * step)
    error = ((slope * along).sum((0, 1)) - difference).abs()
    assert error.median() < 1e-7
    assert error.quantile(0.97) < 1e-4  # kinks lie between the ends of few
