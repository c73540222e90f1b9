"""64 irregular particles that move in every way, for tests of conservation."""

import torch
from bodies import NO_GRAVITY, lattice, one_scene, seeded, uniform

from pcnclaws.mpm.state import ParticleState, Scenes

PARTICLES = 64


def moving_body(seed: int = 0) -> tuple[ParticleState, Scenes]:
    """An irregular body with random velocities, affine velocities, strains and masses."""
    generator = seeded(seed)
    position = lattice((4, 4, 4), (0.2, 0.2, 0.2)) + 0.02 * uniform(generator, 3, PARTICLES)
    state = ParticleState(
        position,
        uniform(generator, 3, PARTICLES),
        20.0 * uniform(generator, 3, 3, PARTICLES),
        torch.eye(3).double()[:, :, None] + 0.1 * uniform(generator, 3, 3, PARTICLES),
    )
    scenes = one_scene(PARTICLES, 0.2**3 / PARTICLES, gravity=NO_GRAVITY)
    return state, scenes._replace(mass=scenes.mass * uniform(generator, PARTICLES, low=0.5, high=1.5))


def stress_free(state: ParticleState) -> torch.Tensor:
    return torch.zeros_like(state.deformation)
