"""A moving batch that uses everything a step has, and what a simulator makes of it with each backend."""

from collections.abc import Sequence
from typing import NamedTuple

import torch
from bodies import per_particle, seeded, uniform
from torch import Tensor
from torch.autograd import forward_ad

from pcnclaws.compiled.law_source import LawKernel
from pcnclaws.laws.analytic import Laws, analytic_laws
from pcnclaws.laws.law import Law
from pcnclaws.laws.materials import material_named
from pcnclaws.laws.networks import ConditionalMLP
from pcnclaws.laws.neural import build_neural_laws
from pcnclaws.mpm.integrator import MPMIntegrator
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.mpm.state import ParticleState, Scenes
from pcnclaws.simulation.simulator import Simulator

MATERIALS = ("elasticity", "plasticine", "sand", "neo_hookean", "tresca")
MODELS = {
    "neural": "pcnclaws",
    "energy": "pcnclaws_energy",
    "free flow": "pcnclaws_free_flow",
    "no prior": "pcnclaws_no_prior",
}
COUNTS = (70, 5, 64)  # particles of the scenes: whole and broken blocks


class Batch(NamedTuple):
    """Scenes near two walls, strained, some particles not at all."""

    state: ParticleState
    scenes: Scenes
    parameters: dict[str, Tensor]


def laws_of(material: str, kind: str, width: int = 64) -> Laws:
    """The analytic laws, or neural ones whose networks say something."""
    if kind == "analytic":
        return analytic_laws(material_named(material))
    torch.manual_seed(0)
    laws = build_neural_laws(material_named(material), {"name": MODELS[kind], "width": width})
    for law in laws[:2]:
        if law is not None:
            torch.nn.init.normal_(network_of(law).weights[2], std=0.05)
    return laws


def network_of(law: Law) -> ConditionalMLP:
    assert isinstance(law.network, ConditionalMLP)
    return law.network


def kernel_of(law: Law) -> LawKernel:
    assert law.kernel is not None
    return law.kernel


def simulator_of(
    material: str, kind: str, boundary: str = "separate", width: int = 64, window: bool = True, transfer: str = "apic"
) -> Simulator:
    settings = SimulationSettings(boundary=boundary, transfer=transfer)
    laws = laws_of(material, kind, width)
    return Simulator(laws.elasticity, laws.plasticity, MPMIntegrator(settings, window)).double()


def moving_batch(material: str, counts: Sequence[int] = COUNTS) -> Batch:
    generator, particles = seeded(3), sum(counts)
    deformation = torch.eye(3).double()[:, :, None] + 0.05 * uniform(generator, 3, 3, particles)
    deformation[:, :, :3] = torch.eye(3).double()[:, :, None]  # three stretches that coincide, and two
    deformation[:, :, 3] = torch.diag(torch.tensor([1.02, 1.02, 0.98]))
    state = ParticleState(
        0.07 + 0.2 + 0.2 * uniform(generator, 3, particles),
        uniform(generator, 3, particles),
        uniform(generator, 3, 3, particles),
        deformation,
    )
    index = torch.repeat_interleave(torch.arange(len(counts)), torch.tensor(counts))
    mass = 0.125 * uniform(generator, particles, low=0.5, high=1.5)
    gravity = uniform(generator, 3, len(counts))
    values = per_particle(material_named(material).defaults, particles)
    parameters = {name: value * uniform(generator, particles, low=0.9, high=1.1) for name, value in values.items()}
    return Batch(state, Scenes(index, mass, mass / 1000.0, gravity), parameters)


def in_dtype(batch: Batch, dtype: torch.dtype) -> Batch:
    state, scenes, parameters = batch
    floats = [field if field.dtype == torch.int64 else field.to(dtype) for field in scenes]
    return Batch(
        ParticleState(*(field.to(dtype) for field in state)),
        Scenes(*floats),
        {name: value.to(dtype) for name, value in parameters.items()},
    )


def after_steps(simulator: Simulator, batch: Batch, steps: int = 3) -> ParticleState:
    state = batch.state
    for _ in range(steps):
        state = simulator(state, batch.scenes, batch.parameters)
    return state


def gradients(simulator: Simulator, batch: Batch) -> list[Tensor]:
    """Of a scalar of the state after some steps: with respect to the state, the parameters and the weights."""
    state = ParticleState(*(field.clone().requires_grad_() for field in batch.state))
    parameters = {name: value.clone().requires_grad_() for name, value in batch.parameters.items()}
    after = after_steps(simulator, Batch(state, batch.scenes, parameters))
    generator = seeded(4)
    scalars = [(field * uniform(generator, *field.shape).to(field)).sum() for field in after]
    return list(torch.autograd.grad(scalars, [*state, *parameters.values(), *simulator.parameters()]))


def rates(simulator: Simulator, batch: Batch) -> list[Tensor]:
    """Of the state after two steps, in forward mode, while all of the state and of the parameters change."""
    generator = seeded(5)
    with forward_ad.dual_level(), torch.no_grad():

        def changing(value: Tensor, scale: float) -> Tensor:
            return forward_ad.make_dual(value, scale * value.abs().mean() * uniform(generator, *value.shape).to(value))

        state = ParticleState(*(changing(field, 1.0) for field in batch.state))
        parameters = {name: changing(value, 0.1) for name, value in batch.parameters.items()}
        after = after_steps(simulator, Batch(state, batch.scenes, parameters), steps=2)
        found = [forward_ad.unpack_dual(field).tangent for field in after]
    return [rate for rate in found if rate is not None]


def largest_difference(found: Sequence[Tensor], expected: Sequence[Tensor]) -> float:
    """Largest difference of two lists of tensors, each relative to the largest number of the expected tensor."""
    # those without a number, the internal variables of laws that have none, differ in nothing
    pairs = [(a.detach().double(), b.detach().double()) for a, b in zip(found, expected, strict=True) if b.numel()]
    # not max(), which passes over a NaN
    return float(torch.stack([(a - b).abs().max() / b.abs().max() for a, b in pairs]).max())
