"""Is a run physical? Conserved quantities, the time-step limit, and which particles have gone wrong."""

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from pcnclaws.compiled.calls import kernels_serve
from pcnclaws.compiled.failing import failing
from pcnclaws.linalg3 import determinant
from pcnclaws.mpm.state import ParticleState, Scenes
from pcnclaws.tensor_types import ParticleMask


def failing_particles(state: ParticleState) -> ParticleMask:
    """Particles whose state is not physical: not finite, outside the domain [0, 1]^3, or det F <= 0."""
    if kernels_serve(state.position, (state.deformation,)):
        return failing(state.position, state.deformation)
    inside = ((state.position >= 0.0) & (state.position <= 1.0)).all(0)
    # comparisons with NaN are false, and an infinite velocity leaves the domain in the next step
    return ~(inside & (determinant(state.deformation) > 0.0))


def left_domain(state: ParticleState, particle: int) -> bool:
    """Whether a particle is at a known place outside the domain."""
    position = state.position[:, particle]
    return bool(torch.isfinite(position).all() and ((position < 0.0) | (position > 1.0)).any())


def place_outside(position: Sequence[float], lower: float, upper: float) -> str:
    """A position [m] in words, with as many digits as it takes to see that a coordinate is not within the limits."""
    texts: list[str] = []
    for digits in (4, 7, 10, 17):
        texts = [f"{x:.{digits}g}" for x in position]
        if any(not lower <= float(text) <= upper for text in texts):
            break
    return f"({', '.join(texts)})"


def why_failing(state: ParticleState, particle: int) -> str:
    """In words, what is wrong with a failing particle."""
    position = state.position[:, particle]
    if not bool(torch.isfinite(position).all() and torch.isfinite(state.deformation[:, :, particle]).all()):
        return "its state is not finite"
    if left_domain(state, particle):
        return f"it left the domain [0, 1]^3 m at {place_outside(position.tolist(), 0.0, 1.0)}"
    jacobian = float(determinant(state.deformation[:, :, particle : particle + 1])[0])
    return f"its deformation gradient turned inside out (det F = {jacobian:.3g})"


def linear_momentum(state: ParticleState, scenes: Scenes) -> Tensor:
    """Linear momentum of each scene [kg m/s], (3, scenes)."""
    return _sum_by_scene(scenes.mass * state.velocity, scenes)


def angular_momentum(state: ParticleState, scenes: Scenes, spacing: float) -> Tensor:
    """Angular momentum of each scene about the origin [kg m^2/s], (3, scenes), its affine part included.

    A particle with affine velocity C carries the spin of m dx^2/4 C beside x x m v (Jiang et al. 2015).
    """
    moment = scenes.mass * (state.velocity[:, None] * state.position[None] + (0.25 * spacing**2) * state.affine)
    spin = torch.stack((moment[2, 1] - moment[1, 2], moment[0, 2] - moment[2, 0], moment[1, 0] - moment[0, 1]))
    return _sum_by_scene(spin, scenes)


def kinetic_energy(state: ParticleState, scenes: Scenes) -> Tensor:
    """Kinetic energy of each scene [J], (scenes,), of the particle velocities alone."""
    return _sum_by_scene(0.5 * scenes.mass * state.velocity.square().sum(0, keepdim=True), scenes)[0]


def cfl_number(time_step: float, spacing: float, wave_speed: float, speed: float) -> float:
    """CFL number dt (c + |v|) / dx [-]."""
    return time_step * (wave_speed + speed) / spacing


def fall_speed(start_speed: float, height: float, gravity: float) -> float:
    """Speed after a fall of `height` [m] that begins with start_speed [m/s]."""
    return math.sqrt(start_speed**2 + 2.0 * gravity * height)


def _sum_by_scene(values: Tensor, scenes: Scenes) -> Tensor:
    return values.new_zeros(values.shape[0], scenes.scene_count).index_add(1, scenes.scene_index, values)
