"""The energy of simulated bodies: what a stable run cannot gain."""

from collections.abc import Callable

import torch
from torch import Tensor

from pcnclaws.laws.base import Elasticity
from pcnclaws.laws.elasticity import FixedCorotated, StVKHencky
from pcnclaws.laws.parameters import lame_constants
from pcnclaws.linalg3 import determinant, hencky_strain, left_stretch, trace
from pcnclaws.mpm.state import ParticleState, Scenes
from pcnclaws.tensor_types import Matrices, Parameters, Scalars


def scene_energy(
    state: ParticleState, scenes: Scenes, parameters: Parameters, elasticity: Elasticity, spacing: float
) -> Tensor:
    """Kinetic and elastic energy of each scene [J], (scenes,), double precision.

    The kinetic energy includes that of the affine velocities, m dx^2 / 8 |C|^2.
    elasticity  an analytic law
    """
    doubled = {name: values.double() for name, values in parameters.items()}
    speeds = state.velocity.double().square().sum(0) + 0.25 * spacing**2 * state.affine.double().square().sum((0, 1))
    elastic = _DENSITIES[type(elasticity)](state.deformation.double(), doubled)
    return _by_scene(0.5 * scenes.mass.double() * speeds + scenes.volume.double() * elastic, scenes)


def potential_energy(state: ParticleState, scenes: Scenes, floor: float) -> Tensor:
    """Energy of gravity of each scene [J], (scenes,), zero when everything lies at the height `floor` [m]."""
    heights = scenes.mass.double() * (state.position[1].double() - floor)
    return -scenes.gravity[1].double() * _by_scene(heights, scenes)


def _fixed_corotated(deformation: Matrices, parameters: Parameters) -> Scalars:
    """Energy per initial volume mu |F - R|^2 + lambda / 2 (J - 1)^2 [J/m^3]."""
    lam, mu = lame_constants(parameters)
    v, b = left_stretch(deformation)
    return mu * (trace(b) - 2.0 * trace(v) + 3.0) + 0.5 * lam * (determinant(deformation) - 1.0).square()


def _hencky(deformation: Matrices, parameters: Parameters) -> Scalars:
    """Energy per initial volume mu |h|^2 + lambda / 2 (tr h)^2 [J/m^3]."""
    lam, mu = lame_constants(parameters)
    h = hencky_strain(deformation)
    return mu * h.square().sum((0, 1)) + 0.5 * lam * trace(h).square()


def _by_scene(values: Scalars, scenes: Scenes) -> Tensor:
    return torch.zeros(scenes.scene_count, dtype=values.dtype, device=values.device).index_add(
        0, scenes.scene_index, values
    )


_DENSITIES: dict[type[Elasticity], Callable[[Matrices, Parameters], Scalars]] = {
    FixedCorotated: _fixed_corotated,
    StVKHencky: _hencky,
}
