"""The package against an independent NumPy loop, and single against double precision."""

from itertools import product
from typing import NamedTuple

import numpy as np
import pytest
import reference_mpm as reference
import torch
from bodies import (
    EARTH,
    NO_GRAVITY,
    analytic_simulator,
    in_precision,
    lattice,
    one_scene,
    paper_cube,
    per_particle,
    seeded,
    spinning,
    uniform,
)
from conftest import SLOW_IN_PYTORCH

from pcnclaws.laws.materials import MATERIALS
from pcnclaws.mpm.contact import VERSION_1_STICK
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.mpm.state import ParticleState
from pcnclaws.simulation.rollout import simulate

pytestmark = pytest.mark.usefixtures("each_backend")


class Motion(NamedTuple):
    """How a body starts: centre [m], velocity [m/s], spin [rad/s], and the gravity that acts on it."""

    centre: tuple[float, float, float]
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    spin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gravity: tuple[float, float, float] = EARTH


MOTIONS = {
    "falling": Motion((0.5, 0.5, 0.45)),
    "bouncing": Motion((0.5, 0.24, 0.5), velocity=(0.3, -3.0, 0.1)),
    "spinning": Motion((0.5, 0.5, 0.5), spin=(3.0, 10.0, -6.0), gravity=NO_GRAVITY),
    "two walls": Motion((0.24, 0.23, 0.5), velocity=(-2.0, -2.5, 0.7), spin=(0.0, 0.0, 4.0)),
}
GRIDS = list(product((20, 32), ("separate", VERSION_1_STICK)))
PARAMETERS = {
    "elasticity": {"youngs_modulus": 2e5, "poissons_ratio": 0.3},
    "plasticine": {"youngs_modulus": 3e5, "poissons_ratio": 0.25, "yield_stress": 3e3},
    "sand": {"youngs_modulus": 3e5, "poissons_ratio": 0.2, "friction_angle": 28.0},
    "neo_hookean": {"youngs_modulus": 2e5, "poissons_ratio": 0.3},
    "tresca": {"youngs_modulus": 3e5, "poissons_ratio": 0.25, "yield_stress": 3e3},
}
SIDES = (0.2, 0.18, 0.15)
COUNTS = (5, 4, 4)
PARTICLES = 80
STEPS = 70


def irregular_body(motion: Motion) -> tuple[ParticleState, torch.Tensor]:
    """80 unequal particles, slightly displaced and already strained, and their volumes."""
    generator = seeded(7)
    position = lattice(COUNTS, SIDES, motion.centre) + 0.005 * uniform(generator, 3, PARTICLES)
    state = ParticleState.at_rest_shape(position, spinning(position, motion.velocity, motion.spin))
    strained = state.deformation + 0.02 * uniform(generator, 3, 3, PARTICLES)
    volume = 0.2 * 0.18 * 0.15 / PARTICLES * uniform(generator, PARTICLES, low=0.8, high=1.2)
    return state._replace(deformation=strained), volume


def reference_run(
    state: ParticleState, volume: torch.Tensor, material: str, settings: SimulationSettings
) -> np.ndarray:
    position, velocity, affine, deformation = (np.moveaxis(field.numpy(), -1, 0).copy() for field in state[:4])
    body = reference.Body(position, velocity, affine, deformation, settings.density * volume.numpy(), volume.numpy())
    same = reference.Settings(
        settings.time_step,
        round(1 / settings.grid_spacing),
        settings.wall_distance,
        settings.gravity,
        settings.boundary,
    )
    return reference.simulate(body, material, PARAMETERS[material], same, STEPS).position


def assert_same_motion(material: str, motion: Motion, grid_nodes: int, boundary: str) -> None:
    settings = SimulationSettings(5e-4, 1 / grid_nodes, 0.1, motion.gravity, boundary)
    state, volume = irregular_body(motion)
    scenes = one_scene(PARTICLES, 1.0, gravity=motion.gravity)._replace(mass=settings.density * volume, volume=volume)
    step = analytic_simulator(material, settings).step_function(scenes, per_particle(PARAMETERS[material], PARTICLES))
    positions = simulate(step, state, scenes, STEPS, every=STEPS).position
    assert (positions[-1] - positions[0]).abs().max() > 0.005
    expected = reference_run(state, volume, material, settings)
    np.testing.assert_allclose(positions[-1].T.numpy(), expected, rtol=0, atol=1e-10)


# each material, motion and kind of grid at least once; the rest of their combinations is for the slow tests
FAST = [
    (material, motion, *GRIDS[(2 * i + j) % 4])
    for (i, material), (j, motion) in product(enumerate(PARAMETERS), enumerate(MOTIONS))
    if (i + j) % 2 == 1
]


@pytest.mark.parametrize(("material", "motion", "grid_nodes", "boundary"), FAST[:6])
def test_positions_agree_with_an_independent_loop(material: str, motion: str, grid_nodes: int, boundary: str) -> None:
    assert_same_motion(material, MOTIONS[motion], grid_nodes, boundary)


@SLOW_IN_PYTORCH
@pytest.mark.parametrize(("material", "motion", "grid_nodes", "boundary"), FAST[6:])
def test_positions_of_other_laws_agree(material: str, motion: str, grid_nodes: int, boundary: str) -> None:
    assert_same_motion(material, MOTIONS[motion], grid_nodes, boundary)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("material", "motion", "grid_nodes", "boundary"),
    [case for case in ((m, n, *g) for m, n, g in product(PARAMETERS, MOTIONS, GRIDS)) if case not in FAST],
)
def test_positions_agree_for_all_combinations(material: str, motion: str, grid_nodes: int, boundary: str) -> None:
    assert_same_motion(material, MOTIONS[motion], grid_nodes, boundary)


def motion_in(dtype: torch.dtype, material: str) -> torch.Tensor:
    """500 steps of the cube of the paper, thrown and spinning: positions at every 5th step."""
    position = paper_cube()
    state = ParticleState.at_rest_shape(position, spinning(position, (0.5, -1.5, 0.3), (1.0, 2.0, -1.0)))
    scenes = in_precision(one_scene(1000, 0.125 / 1000), dtype)
    parameters = per_particle(MATERIALS[material].defaults, 1000, dtype)
    step = analytic_simulator(material, SimulationSettings()).step_function(scenes, parameters)
    return simulate(step, in_precision(state, dtype), scenes, 500, every=5).position.double()


@SLOW_IN_PYTORCH
@pytest.mark.parametrize(
    "material",
    ["elasticity", *(pytest.param(material, marks=pytest.mark.slow) for material in ("plasticine", "sand"))],
)
def test_single_precision_follows_double_precision(material: str) -> None:
    error = motion_in(torch.float32, material) - motion_in(torch.float64, material)
    assert error.square().mean() <= 1e-9
