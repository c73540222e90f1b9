"""What the transfers and a free step conserve."""

import math
from dataclasses import replace

import pytest
import torch
from bodies import (
    NO_GRAVITY,
    analytic_simulator,
    in_precision,
    lattice,
    one_scene,
    per_particle,
    seeded,
    spinning,
    uniform,
)
from moving_body import PARTICLES, moving_body, stress_free

from pcnclaws.laws.materials import MATERIALS
from pcnclaws.mpm.diagnostics import angular_momentum, linear_momentum
from pcnclaws.mpm.grid import grid_of
from pcnclaws.mpm.integrator import MPMIntegrator
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.mpm.shape_functions import quadratic_stencil
from pcnclaws.mpm.state import ParticleState
from pcnclaws.mpm.transfer import grid_to_particles, particles_to_grid
from pcnclaws.simulation.rollout import simulate

WEIGHTLESS = SimulationSettings(gravity=NO_GRAVITY)


def test_transfers_to_the_grid_conserve_mass_and_momentum() -> None:
    state, scenes = moving_body()
    grid = grid_of(WEIGHTLESS)
    stencil = quadratic_stencil(state.position, scenes.scene_index, grid, grid.stencil_offsets())
    nodes = particles_to_grid(
        stencil, scenes.mass, scenes.mass * state.velocity, 1e3 * state.affine, grid.spacing, grid.size
    )
    torch.testing.assert_close(nodes[3].sum(), scenes.mass.sum(), rtol=1e-15, atol=0)
    torch.testing.assert_close(nodes[:3].sum(1), linear_momentum(state, scenes)[:, 0], rtol=0, atol=2e-12)


def test_transfers_back_reproduce_a_linear_velocity_field() -> None:
    state, scenes = moving_body()
    grid, gradient = grid_of(WEIGHTLESS), uniform(seeded(1), 3, 3)
    stencil = quadratic_stencil(state.position, scenes.scene_index, grid, grid.stencil_offsets())
    axis = grid.axis(0)
    points = torch.stack(torch.meshgrid(axis, axis, axis, indexing="ij")).flatten(1)
    velocity, affine = grid_to_particles(stencil, gradient @ points, grid.spacing)
    torch.testing.assert_close(velocity, gradient @ state.position, rtol=0, atol=1e-14)
    torch.testing.assert_close(affine, gradient[:, :, None].expand_as(affine), rtol=0, atol=1e-12)


@pytest.mark.parametrize("transfer", ["apic", "axpic3"])
@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
def test_a_step_without_gravity_conserves_momentum_even_under_stress(dtype: torch.dtype, transfer: str) -> None:
    state, scenes = moving_body()
    state, scenes = in_precision(state, dtype), in_precision(scenes, dtype)
    step = analytic_simulator("elasticity", replace(WEIGHTLESS, transfer=transfer)).step_function(
        scenes, per_particle(MATERIALS["elasticity"].defaults, PARTICLES, dtype)
    )
    after = simulate(step, state, scenes, 50, every=50)
    change = linear_momentum(state._replace(velocity=after.velocity[-1]), scenes) - linear_momentum(state, scenes)
    scale = (scenes.mass * state.velocity.abs()).sum()
    assert change.abs().max() / scale < 20 * torch.finfo(dtype).eps


def kept_by_a_bar(transfer: str, cfl: float) -> float:
    """The share of its amplitude that a free bar on 8 cells keeps over five periods."""
    cells, dx, speed = 8, 1.0 / 12, 1e-3
    length, particles = cells * dx, 16 * cells // 2
    period = 2.0 * length  # E and density are 1, and so is the speed of sound
    steps = round(5.0 * period / (cfl * dx))
    settings = SimulationSettings(5.0 * period / steps, dx, 0.0, NO_GRAVITY, density=1.0, transfer=transfer)
    position = lattice((2 * cells, 2, 2), (length, dx, dx))
    phase, along = math.pi * (position[0] - 0.5 + 0.5 * length) / length, torch.tensor([1.0, 0.0, 0.0]).double()
    shape, slope = phase.cos(), -math.pi / length * phase.sin()
    affine = speed * torch.einsum("i,j,p->ijp", along, along, slope)
    state = ParticleState.at_rest_shape(position, speed * along[:, None] * shape, affine)
    scenes = one_scene(particles, length * dx**2 / particles, 1.0, NO_GRAVITY)
    step = analytic_simulator("elasticity", settings).step_function(
        scenes, per_particle({"youngs_modulus": 1.0, "poissons_ratio": 0.0}, particles)
    )
    velocity = simulate(step, state, scenes, steps, every=2).velocity[:, 0]
    share = velocity @ shape / (speed * shape @ shape)
    return float(share[-len(share) // 10 :].abs().max())  # in half a period: that of the grid is a little longer


def test_affine_xpic_keeps_what_apic_loses_in_short_steps() -> None:
    kept = {(transfer, cfl): kept_by_a_bar(transfer, cfl) for transfer in ("apic", "axpic3") for cfl in (0.4, 0.1)}
    assert kept["apic", 0.1] < 0.85 < 0.9 < kept["apic", 0.4]
    assert kept["axpic3", 0.1] > max(0.98, kept["axpic3", 0.4] - 0.01)


@pytest.mark.parametrize("transfer", ["apic", "axpic2", "axpic4"])
@pytest.mark.parametrize("elastic", [False, True], ids=["no stress", "elastic"])
def test_free_rotation_conserves_angular_momentum_with_its_affine_part(elastic: bool, transfer: str) -> None:
    state, scenes = moving_body()
    spin = spinning(state.position, (0.3, -0.2, 0.1), (2.0, -5.0, 8.0))
    state = ParticleState.at_rest_shape(state.position, spin)
    settings = replace(WEIGHTLESS, transfer=transfer)
    integrator = MPMIntegrator(settings)
    elastic_step = analytic_simulator("elasticity", settings).step_function(
        scenes, per_particle(MATERIALS["elasticity"].defaults, PARTICLES)
    )
    at_start = angular_momentum(state, scenes, integrator.grid.spacing)
    for _ in range(100):
        state = elastic_step(state) if elastic else integrator(state, stress_free(state), scenes)
    after = angular_momentum(state, scenes, integrator.grid.spacing)
    without_affine = angular_momentum(state._replace(affine=0.0 * state.affine), scenes, integrator.grid.spacing)
    torch.testing.assert_close(after, at_start, rtol=1e-12, atol=0)
    assert (without_affine - at_start).abs().max() > 1e-3 * at_start.abs().max()
