"""Domains of any size and place: similarity, a column in metres, no bounds; loads."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from bodies import NO_GRAVITY, analytic_simulator, lattice, one_scene, per_particle, seeded, uniform

from pcnclaws.compiled.backend import using_backend
from pcnclaws.errors import SimulationDiverged, UserError
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.mpm.colliders import Collider
from pcnclaws.mpm.integrator import MPMIntegrator
from pcnclaws.mpm.loads import Load
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.mpm.state import ParticleState
from pcnclaws.simulation.execution import Execution
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.rollout import simulate
from pcnclaws.simulation.scenes import SceneStart

both = pytest.mark.parametrize("backend", ["torch", "auto"])
slow_in_pytorch = pytest.mark.parametrize("backend", [pytest.param("torch", marks=pytest.mark.slow), "auto"])


def end_of(start: SceneStart, steps: int) -> np.ndarray:
    laws = analytic_laws(MATERIALS[start.material])
    return simulate_records([start], laws, FramePlan(steps, steps), Execution(torch.float64))[0].position[-1]


@pytest.mark.parametrize(
    ("backend", "corner"),
    [
        pytest.param("torch", (0.3, -1.0, 7.0), marks=pytest.mark.slow),
        ("auto", (0.0, 0.0, 0.0)),
        ("auto", (0.3, -1.0, 7.0)),
    ],
)
def test_a_small_box_anywhere_equals_the_unit_box_by_similarity(backend: str, corner: tuple[float, ...]) -> None:
    """Lengths by a, times by a, so that speeds stay: moduli stay, gravity is divided by a."""
    a = 0.2
    unit = SimulationSettings(5e-4, 1 / 40)
    low = (corner[0], corner[1], corner[2])
    small = SimulationSettings(
        a * unit.time_step,
        0.005,
        a * unit.wall_distance,
        (0.0, -9.8 / a, 0.0),
        domain=(low, (low[0] + a, low[1] + a, low[2] + a)),
    )
    position = lattice((5, 5, 5), (0.2, 0.2, 0.2), (0.4, 0.22, 0.5)).T.numpy()
    velocity = np.tile([-1.0, -3.0, 0.5], (125, 1))
    volume = np.full(125, 0.2**3 / 125)
    parameters = MATERIALS["sand"].defaults
    start = SceneStart("unit", "sand", unit, parameters, position, velocity, volume)
    scaled = SceneStart("small", "sand", small, parameters, a * position + low, velocity, a**3 * volume)
    with using_backend(backend):
        end, small_end = end_of(start, 50), end_of(scaled, 50)
    assert np.abs(end - position).max() > 0.02
    np.testing.assert_allclose((small_end - low) / a, end, rtol=0, atol=1e-6)


@both
def test_a_column_of_ten_metres_stands_on_its_floor_and_costs_what_it_touches(backend: str) -> None:
    settings = SimulationSettings(5e-4, 0.25, 0.5, domain=((-10.0, 0.0, -10.0), (10.0, 20.0, 10.0)))
    position = lattice((4, 40, 4), (1.0, 10.0, 1.0), (0.0, 5.5, 0.0)).T.numpy()
    volume = np.full(640, 10.0 / 640)
    parameters = {"youngs_modulus": 1e7, "poissons_ratio": 0.2}
    start = SceneStart("column", "elasticity", settings, parameters, position, np.zeros((640, 3)), volume)
    integrator = MPMIntegrator(settings)
    state = ParticleState.at_rest_shape(torch.from_numpy(position.T.copy()), torch.zeros(3, 640, dtype=torch.float64))
    assert integrator.grid.size > 5e5
    assert integrator.grid.window(state.position).size < 5e3
    with using_backend(backend):
        end = end_of(start, 20)
    assert np.abs(end - position).max() < 1e-3  # it is free to fall 5 mm
    assert np.isfinite(end).all()


@both
def test_an_unbounded_domain_lets_bodies_fall_and_a_plane_stops_them(backend: str) -> None:
    position = lattice((4, 4, 4), (0.15, 0.15, 0.15), (500.0, -20.0, 3.0)).T.numpy()
    parameters, volume = {"youngs_modulus": 1e5, "poissons_ratio": 0.3}, np.full(64, 0.15**3 / 64)
    floor = Collider.plane((0.0, -21.0, 0.0), (0.0, 1.0, 0.0))
    ends = []
    for colliders in ((), (floor,)):
        settings = SimulationSettings(1e-3, domain=None, colliders=colliders)
        start = SceneStart("falls", "elasticity", settings, parameters, position, np.zeros((64, 3)), volume)
        with using_backend(backend):
            ends.append(end_of(start, 600))
    n, dt = 600, 1e-3
    np.testing.assert_allclose(ends[0] - position, [[0.0, -9.8 * dt**2 * n * (n + 1) / 2, 0.0]] * 64, atol=1e-9)
    assert ends[1][:, 1].min() > -21.05


def test_particles_that_fly_apart_without_bounds_are_reported() -> None:
    settings = SimulationSettings(1e-3, domain=None, colliders=(Collider.sphere((0.0, 0.0, 0.0), 0.1),))
    position = np.array([[-1e5, 1.0, 0.0], [1e5, 1.0, 1e5]])
    parameters = {"youngs_modulus": 1e5, "poissons_ratio": 0.3}
    start = SceneStart("far", "elasticity", settings, parameters, position, 0.1 * position, np.full(2, 1e-6))
    with pytest.raises(SimulationDiverged, match="more than can be stored"):
        end_of(start, 2)


def test_a_domain_that_is_not_a_whole_number_of_cells_is_refused() -> None:
    for change, fault in (
        ({"domain": ((0.0,) * 3, (0.2, 0.2, 0.21)), "wall_distance": 0.0}, "whole number of cells"),
        ({"domain": ((0.0,) * 3, (0.2, 0.2, 0.0))}, "is empty"),
        ({"domain": ((0.0,) * 3, (0.1, 1.0, 1.0))}, "from 4 to"),
        ({"domain": ((0.0,) * 3, (0.2, 1.0, 1.0))}, "wall_distance=0.1 is out of range; accepted: 0 to below 0.1 m"),
        ({"boundary": "slip", "friction": 0.3}, "no effect beside simulation.boundary=slip"),
        ({"friction": -1.0}, "from 0"),
    ):
        with pytest.raises(UserError, match=fault):
            replace(SimulationSettings(), **change)


@both
def test_a_force_moves_the_particles_in_its_box_while_it_acts(backend: str) -> None:
    state = ParticleState.at_rest_shape(lattice((4, 4, 4), (0.16, 0.16, 0.16)), torch.zeros(3, 64).double())
    force = torch.tensor([3.0, 0.0, -6.0], dtype=torch.float64).requires_grad_()
    load = Load((0.5, 0.0, 0.0), (1.0, 1.0, 1.0), force=force, start=0.01, end=0.03)
    settings = SimulationSettings(1e-3, gravity=NO_GRAVITY, loads=(load,))
    scenes = one_scene(64, 0.16**3 / 64, gravity=NO_GRAVITY)
    shares = load.share(state.position, scenes.mass, scenes.scene_index)
    assert int((shares > 0).sum()) == 32
    scenes = scenes._replace(load_shares=shares[None])
    parameters = per_particle({"youngs_modulus": 1e5, "poissons_ratio": 0.3}, 64)
    step = analytic_simulator("elasticity", settings).step_function(scenes, parameters)
    with using_backend(backend):
        for n in range(40):
            state = step(state, n)
        momentum = (scenes.mass * state.velocity).sum(1)
        (slope,) = torch.autograd.grad(momentum[0], force)
    torch.testing.assert_close(momentum.detach(), 0.02 * force.detach(), rtol=1e-10, atol=1e-12)
    torch.testing.assert_close(slope, torch.tensor([0.02, 0.0, 0.0], dtype=torch.float64), rtol=1e-10, atol=1e-12)


@slow_in_pytorch
def test_friction_walls_slow_a_body_that_slides_on_the_floor(backend: str) -> None:
    """Deceleration mu g, as of Coulomb; without friction none."""
    position = lattice((4, 4, 4), (0.15, 0.15, 0.15), (0.4, 0.175, 0.5))
    velocity = torch.tensor([[1.0], [0.0], [0.0]]).double().expand(3, 64) + 0.0 * uniform(seeded(1), 3, 64)
    scenes = one_scene(64, 0.15**3 / 64)
    parameters, speeds = per_particle({"youngs_modulus": 1e5, "poissons_ratio": 0.3}, 64), []
    for friction in (0.0, 0.2):
        settings = SimulationSettings(1e-3, friction=friction)
        step = analytic_simulator("elasticity", settings).step_function(scenes, parameters)
        with using_backend(backend):
            motion = simulate(step, ParticleState.at_rest_shape(position, velocity), scenes, 200, every=200)
        speeds.append(float(motion.velocity[-1, 0].mean()))
    assert speeds[0] == pytest.approx(1.0, rel=1e-10)
    assert 1.0 - speeds[1] == pytest.approx(0.2 * 9.8 * 0.2, rel=0.05)
