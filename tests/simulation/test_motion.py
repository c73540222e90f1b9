"""Motions with a known answer: free fall, free vibration, sliding, and batches of scenes."""

import math

import pytest
import torch
from bodies import (
    NO_GRAVITY,
    analytic_simulator,
    in_precision,
    joined,
    lattice,
    one_scene,
    per_particle,
    seeded,
    spinning,
    uniform,
)
from conftest import SLOW_IN_PYTORCH
from moving_body import PARTICLES, moving_body, stress_free

from pcnclaws.laws.materials import MATERIALS
from pcnclaws.mpm.contact import VERSION_1_STICK
from pcnclaws.mpm.integrator import MPMIntegrator
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.mpm.state import ParticleState, Scenes
from pcnclaws.simulation.rollout import simulate

pytestmark = pytest.mark.usefixtures("each_backend")


@pytest.mark.parametrize("density", [1000.0, 1e-3, 1e-12 * PARTICLES / 0.2**3])
@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float64, 1e-13), (torch.float32, 1e-5)])
def test_free_fall_is_exact_for_heavy_and_light_bodies(dtype: torch.dtype, tolerance: float, density: float) -> None:
    settings, steps = SimulationSettings(wall_distance=0.05), 150
    position = lattice((4, 4, 4), (0.2, 0.2, 0.2), (0.5, 0.6, 0.5)) + 0.01 * uniform(seeded(2), 3, PARTICLES)
    velocity = torch.tensor([0.5, 0.4, -0.3]).double()[:, None].expand(3, PARTICLES)
    state = in_precision(ParticleState.at_rest_shape(position, velocity), dtype)
    scenes = in_precision(one_scene(PARTICLES, 0.2**3 / PARTICLES, density), dtype)
    integrator = MPMIntegrator(settings)
    frames = simulate(lambda s, n=0: integrator(s, stress_free(s), scenes, n), state, scenes, steps)
    n, dt = frames.step.double(), settings.time_step
    expected = position + (n * dt)[:, None, None] * velocity
    expected[:, 1] -= (9.8 * dt**2 * n * (n + 1) / 2)[:, None]
    torch.testing.assert_close(frames.position.double(), expected, rtol=0, atol=tolerance)


@pytest.mark.parametrize("material", ["elasticity", "sand"])
def test_a_batch_of_scenes_equals_separate_runs(material: str) -> None:
    settings = SimulationSettings()
    bodies = [moving_body(seed) for seed in range(3)]
    # scenes of unequal size, in places that overlap, each with its own gravity and parameters
    bodies[1] = (ParticleState(*(f[..., :40] for f in bodies[1][0])), Scenes(*(f[..., :40] for f in bodies[1][1])))
    gravity = uniform(seeded(3), 3, 3, low=-9.0, high=9.0)
    values = [
        {name: low + share * (high - low) for name, (low, high) in MATERIALS[material].ranges.items()}
        for share in (0.2, 0.5, 0.8)
    ]
    parameters = [per_particle(v, body.position.shape[1]) for v, (body, _) in zip(values, bodies, strict=True)]
    simulator = analytic_simulator(material, settings)

    together = Scenes(
        torch.cat([scenes.scene_index + i for i, (_, scenes) in enumerate(bodies)]),
        torch.cat([scenes.mass for _, scenes in bodies]),
        torch.cat([scenes.volume for _, scenes in bodies]),
        gravity,
    )
    all_parameters = {name: torch.cat([p[name] for p in parameters]) for name in MATERIALS[material].ranges}
    batch = joined(*(state for state, _ in bodies))
    batch_run = simulate(simulator.step_function(together, all_parameters), batch, together, 15, every=15).position[-1]

    separate = []
    for i, (state, scenes) in enumerate(bodies):
        alone = scenes._replace(gravity=gravity[:, i : i + 1])
        step = simulator.step_function(alone, parameters[i])
        separate.append(simulate(step, state, alone, 15, every=15).position[-1])
    torch.testing.assert_close(batch_run, torch.cat(separate, dim=1), rtol=0, atol=1e-15)


def first_mode_of_a_bar(length: float, cells: int, youngs_modulus: float) -> float:
    """Measured angular frequency of the first axial vibration of a free-free bar [rad/s], nu = 0."""
    settings = SimulationSettings(8e-3 / cells, 1 / cells, 0.0, NO_GRAVITY)
    spacing, width = settings.grid_spacing, 0.1
    counts = (round(2 * length / spacing), round(2 * width / spacing), round(2 * width / spacing))
    position = lattice(counts, (length, width, width))
    particles = position.shape[1]
    # the first mode moves both ends apart
    shape = torch.sin((math.pi / length) * (position[0] - 0.5))
    velocity = torch.stack((0.02 * shape, 0.0 * shape, 0.0 * shape))
    scenes = one_scene(particles, length * width**2 / particles, gravity=NO_GRAVITY)
    parameters = per_particle({"youngs_modulus": youngs_modulus, "poissons_ratio": 0.0}, particles)
    step = analytic_simulator("elasticity", settings).step_function(scenes, parameters)
    period = 2 * length / math.sqrt(youngs_modulus / 1000.0)
    steps = round(0.9 * period / settings.time_step)
    frames = simulate(step, ParticleState.at_rest_shape(position, velocity), scenes, steps)
    amplitude = (frames.velocity[:, 0] * shape).sum(1)
    # from the first to the second change of sign is half a period
    crossings = [
        n + float(amplitude[n] / (amplitude[n] - amplitude[n + 1]))
        for n in range(steps)
        if (amplitude[n] > 0) != (amplitude[n + 1] > 0)
    ]
    return math.pi / ((crossings[1] - crossings[0]) * settings.time_step)


@SLOW_IN_PYTORCH
def test_a_free_bar_vibrates_at_its_natural_frequency() -> None:
    measured = first_mode_of_a_bar(length=0.6, cells=20, youngs_modulus=1e5)
    assert measured == pytest.approx(math.pi / 0.6 * math.sqrt(1e5 / 1000.0), rel=0.015)


@pytest.mark.slow
def test_the_frequency_of_a_bar_converges_with_order_two() -> None:
    exact = math.pi / 0.6 * math.sqrt(1e5 / 1000.0)
    coarse, fine = (abs(first_mode_of_a_bar(0.6, cells, 1e5) / exact - 1.0) for cells in (20, 40))
    assert fine < coarse / 3.0


def test_a_slip_floor_leaves_the_sliding_momentum_and_a_stick_floor_takes_it() -> None:
    position = lattice((4, 4, 4), (0.2, 0.2, 0.2), (0.4, 0.22, 0.5))
    start = ParticleState.at_rest_shape(position, spinning(position, (0.8, -0.5, 0.0), (0.0, 0.0, 0.0)))
    scenes = one_scene(PARTICLES, 0.2**3 / PARTICLES)
    parameters = per_particle(MATERIALS["elasticity"].defaults, PARTICLES)
    sliding = {}
    for boundary in ("separate", VERSION_1_STICK):
        step = analytic_simulator("elasticity", SimulationSettings(boundary=boundary)).step_function(scenes, parameters)
        frames = simulate(step, start, scenes, 100, every=100)
        assert frames.position[-1, 1].min() > 0.1
        sliding[boundary] = float(frames.velocity[-1, 0].mean())
    assert sliding["separate"] == pytest.approx(0.8, rel=1e-12)
    assert abs(sliding[VERSION_1_STICK]) < 0.7
