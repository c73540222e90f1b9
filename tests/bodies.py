"""Small bodies, scenes and simulators that the physics tests share."""

from collections.abc import Mapping
from typing import TypeVar

import torch
from torch import Tensor

from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.materials import material_named
from pcnclaws.mpm.integrator import MPMIntegrator
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.mpm.state import ParticleState, Scenes
from pcnclaws.simulation.simulator import Simulator

CENTRE = (0.5, 0.5, 0.5)
NO_GRAVITY = (0.0, 0.0, 0.0)
EARTH = (0.0, -9.8, 0.0)


def seeded(seed: int) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def uniform(generator: torch.Generator, *shape: int, low: float = -1.0, high: float = 1.0) -> Tensor:
    """Random float64 numbers between low and high."""
    return low + (high - low) * torch.rand(*shape, generator=generator, dtype=torch.float64)


def lattice(
    counts: tuple[int, int, int], sides: tuple[float, float, float], centre: tuple[float, ...] = CENTRE
) -> Tensor:
    """Points at the middles of the cells of a box [m], (3, particles), float64."""
    axes = [
        middle + side * ((torch.arange(count, dtype=torch.float64) + 0.5) / count - 0.5)
        for count, side, middle in zip(counts, sides, centre, strict=True)
    ]
    return torch.stack(torch.meshgrid(*axes, indexing="ij")).flatten(1)


def paper_cube() -> Tensor:
    """The cube of the paper: side 0.5 m, 10 x 10 x 10 particles on a lattice that includes the faces, (3, 1000)."""
    return lattice((10, 10, 10), (5 / 9, 5 / 9, 5 / 9))


def spinning(position: Tensor, velocity: tuple[float, ...], spin: tuple[float, ...]) -> Tensor:
    """Velocity of a rigid motion with `spin` [rad/s] about the centre of the points."""
    arm = position - position.mean(1, keepdim=True)
    turning = torch.tensor(spin, dtype=position.dtype)[:, None].expand_as(arm)
    return torch.tensor(velocity, dtype=position.dtype)[:, None] + torch.linalg.cross(turning, arm, dim=0)


def one_scene(particles: int, volume: float, density: float = 1000.0, gravity: tuple[float, ...] = EARTH) -> Scenes:
    """The constants of one scene of equal particles, float64, volume [m^3] of each."""
    volumes = torch.full((particles,), volume, dtype=torch.float64)
    return Scenes(
        torch.zeros(particles, dtype=torch.int64),
        density * volumes,
        volumes,
        torch.tensor(gravity, dtype=torch.float64)[:, None],
    )


def joined(*states: ParticleState) -> ParticleState:
    """The bodies one after the other."""
    return ParticleState(*(torch.cat(field, dim=-1) for field in zip(*states, strict=True)))


Fields = TypeVar("Fields", ParticleState, Scenes)


def in_precision(fields: Fields, dtype: torch.dtype) -> Fields:
    """A state or scenes in another precision; whole numbers stay."""
    return type(fields)(*(field.to(dtype) if field.is_floating_point() else field for field in fields))


def per_particle(values: Mapping[str, float], particles: int, dtype: torch.dtype = torch.float64) -> dict[str, Tensor]:
    """Physical parameters of every particle."""
    return {name: torch.full((particles,), value, dtype=dtype) for name, value in values.items()}


def analytic_simulator(material: str, settings: SimulationSettings) -> Simulator:
    """The ground truth of a material."""
    laws = analytic_laws(material_named(material))
    return Simulator(laws.elasticity, laws.plasticity, MPMIntegrator(settings))


def principal(*values: float) -> Tensor:
    """A diagonal matrix, (3, 3, 1)."""
    return torch.diag(torch.tensor(values, dtype=torch.float64))[:, :, None]
