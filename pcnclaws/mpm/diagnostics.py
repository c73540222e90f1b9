"""Is a run physical? Conserved quantities, the time-step limit, and which particles have gone wrong."""

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from pcnclaws.compiled.calls import kernels_serve
from pcnclaws.compiled.failing import failing
from pcnclaws.mpm.settings import UNIT_BOX, Domain
from pcnclaws.mpm.state import ParticleState, Scenes
from pcnclaws.tensors.linalg3 import determinant
from pcnclaws.tensors.tensor_types import ParticleMask


def failing_particles(state: ParticleState, limits: Domain = UNIT_BOX) -> ParticleMask:
    """Particles whose state is not physical: not finite, outside the domain, or det F <= 0.

    limits  SimulationSettings.limits
    """
    if kernels_serve(state.position, (state.deformation,)):
        return failing(state.position, state.deformation, limits)
    low, high = (state.position.new_tensor(corner)[:, None] for corner in limits)
    inside = ((state.position >= low) & (state.position <= high)).all(0)
    # comparisons with NaN are false, and an infinite velocity leaves the domain in the next step
    return ~(inside & (determinant(state.deformation) > 0.0))


def left_domain(state: ParticleState, particle: int, limits: Domain = UNIT_BOX) -> bool:
    """Whether a particle is at a known place outside the domain."""
    position = state.position[:, particle]
    low, high = (position.new_tensor(corner) for corner in limits)
    return bool(torch.isfinite(position).all() and ((position < low) | (position > high)).any())


def domain_in_words(domain: Domain) -> str:
    """The box of a domain [m], as in 'outside the domain ...'."""
    if domain == UNIT_BOX:
        return "the domain [0, 1]^3 m"
    edges = (f"[{low:.6g}, {high:.6g}]" for low, high in zip(*domain, strict=True))
    return f"the domain {' x '.join(edges)} m"


def place_outside(position: Sequence[float], lower: Sequence[float], upper: Sequence[float]) -> str:
    """A position [m] in words, with as many digits as it takes to see that a coordinate is not within the limits."""
    texts: list[str] = []
    for digits in (4, 7, 10, 17):
        texts = [f"{x:.{digits}g}" for x in position]
        if any(not low <= float(text) <= high for text, low, high in zip(texts, lower, upper, strict=True)):
            break
    return f"({', '.join(texts)})"


def why_failing(state: ParticleState, particle: int, limits: Domain = UNIT_BOX) -> str:
    """In words, what is wrong with a failing particle."""
    position = state.position[:, particle]
    if not bool(torch.isfinite(position).all() and torch.isfinite(state.deformation[:, :, particle]).all()):
        return "its state is not finite"
    if left_domain(state, particle, limits):
        return f"it left {domain_in_words(limits)} at {place_outside(position.tolist(), *limits)}"
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
