"""Conserved quantities of a state, and the numbers of a time step's limit."""

import math

import torch
from torch import Tensor

from pcnclaws.mpm.state import ParticleState, Scenes


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
