"""Colliders: distances, contact and friction, momentum and impulse, derivatives, walls as planes."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
import torch
from bodies import NO_GRAVITY, analytic_simulator, lattice, one_scene, per_particle, seeded, uniform
from torch import Tensor
from torch.autograd import forward_ad

import pcnclaws as pc
from pcnclaws.compiled.backend import using_backend
from pcnclaws.errors import UserError
from pcnclaws.mpm.colliders import Collider
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.mpm.state import ParticleState, Scenes
from pcnclaws.simulation.batch import SceneBatch
from pcnclaws.simulation.fast_paths import Skips
from pcnclaws.simulation.recording import FramePlan, Trajectory
from pcnclaws.simulation.rollout import differentiable_rollout, simulate_scenes

pytestmark = pytest.mark.filterwarnings("ignore:`torch.jit.script` is deprecated:DeprecationWarning")


def doubles(values: object) -> Tensor:
    return torch.tensor(values, dtype=torch.float64)


CENTRE = (0.5, 0.4, 0.6)
SHAPES = {
    "plane": Collider.plane(CENTRE, (1.0, 2.0, -1.0)),
    "sphere": Collider.sphere(CENTRE, 0.2),
    "box": Collider.box((0.4, 0.2, 0.5), (0.6, 0.6, 0.7)),
    "capsule": Collider.capsule((0.3, 0.4, 0.6), (0.7, 0.4, 0.6), 0.15),
    "cylinder": Collider.cylinder((0.5, 0.2, 0.6), (0.5, 0.6, 0.6), 0.2),
}
# on the surface of each
SURFACE = {
    "plane": [0.5, 0.5, 0.8],
    "sphere": [0.5, 0.6, 0.6],
    "box": [0.6, 0.3, 0.55],
    "capsule": [0.85, 0.4, 0.6],
    "cylinder": [0.7, 0.45, 0.6],
}


@pytest.mark.parametrize("shape", SHAPES)
def test_normals_are_slopes_of_distances_which_vanish_on_the_surface(shape: str) -> None:
    points = uniform(seeded(3), 3, 200, low=0.0, high=1.0).requires_grad_()
    distance, normal, velocity = SHAPES[shape].distance(points, 0.0)
    (slope,) = torch.autograd.grad(distance.sum(), points)
    torch.testing.assert_close(normal, slope, rtol=0, atol=1e-12)
    torch.testing.assert_close(normal.norm(dim=0), torch.ones(200).double(), rtol=0, atol=1e-12)
    assert not velocity.any()
    on_surface = SHAPES[shape].distance(doubles([SURFACE[shape]]).T, 0.0)[0]
    assert float(on_surface) == pytest.approx(0.0, abs=1e-12)


def test_a_collider_moves_and_turns_with_its_velocity_and_spin() -> None:
    turning = Collider.box((0.0, 0.0, 0.0), (2.0, 0.2, 0.2), velocity=(0, 1, 0), spin=(0, 0, math.pi), start=0.5)
    corner = doubles([2.0, 0.1, 0.1]) - doubles([1.0, 0.1, 0.1])
    turned = torch.stack((-corner[1], corner[0], corner[2]))  # by a quarter, after half a second
    place = doubles([1.0, 0.1 + 0.5, 0.1]) + turned
    distance, normal, velocity = turning.distance(place[:, None], 1.0)
    torch.testing.assert_close(distance, torch.zeros(1).double(), rtol=0, atol=1e-12)
    torch.testing.assert_close(normal[:, 0], doubles([0.0, 1.0, 0.0]), rtol=0, atol=1e-12)
    torch.testing.assert_close(velocity[:, 0], doubles([-math.pi, 1.0, 0.0]), rtol=0, atol=1e-12)


def block(normal_to: float = 0.0, height: float = 0.0, spin: float = 0.0) -> ParticleState:
    """A cube of 64 particles above the origin, turned about z by an angle."""
    upright = lattice((4, 4, 4), (0.15, 0.15, 0.15), (0.0, height, 0.0))
    c, s = math.cos(normal_to), math.sin(normal_to)
    turn = doubles([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    position = turn @ upright
    return ParticleState.at_rest_shape(position, torch.zeros_like(position))


def scene_of(gravity: tuple[float, float, float]) -> Scenes:
    return one_scene(64, 0.2**3 / 64, gravity=gravity)


PARAMETERS = {"youngs_modulus": 1e5, "poissons_ratio": 0.3}
UNBOUNDED = SimulationSettings(5e-4, 0.05, domain=None, gravity=NO_GRAVITY)


def run(settings: SimulationSettings, state: ParticleState, steps: int, skips: Skips | None = None) -> Trajectory:
    simulator = analytic_simulator("elasticity", settings)
    plan = FramePlan(steps, steps, velocities=True)
    parameters = per_particle(PARAMETERS, state.position.shape[1])
    return simulate_scenes(simulator, SceneBatch(state, scene_of(settings.gravity), parameters), plan, skips)


def settings_with(*colliders: Collider, gravity: tuple[float, float, float] = NO_GRAVITY) -> SimulationSettings:
    return SimulationSettings(5e-4, 0.05, domain=None, gravity=gravity, colliders=colliders)


@pytest.mark.parametrize(
    ("slope", "friction"), [pytest.param(30.0, 0.0, marks=pytest.mark.slow), (30.0, 0.3), (20.0, 0.5)]
)
def test_a_block_on_an_inclined_plane_slides_as_coulomb_says_or_stays(slope: float, friction: float) -> None:
    angle, g = math.radians(slope), 9.8
    # the plane rises along x; the block begins on it
    normal = (-math.sin(angle), math.cos(angle), 0.0)
    plane = Collider.plane((0.0, 0.0, 0.0), normal, friction=friction)
    state = block(angle, 0.075)
    settings = replace(settings_with(plane, gravity=(0.0, -g, 0.0)), time_step=1e-3)
    simulator = analytic_simulator("elasticity", settings)
    parameters = per_particle(PARAMETERS, 64)
    plan = FramePlan(600, 200, velocities=True)
    motion = simulate_scenes(simulator, SceneBatch(state, scene_of(settings.gravity), parameters), plan)
    downhill = torch.tensor([-math.cos(angle), -math.sin(angle), 0.0]).double()
    speed = (downhill[:, None] * motion.velocity.mean(2).T).sum(0)
    acceleration = float(speed[3] - speed[1]) / (400 * settings.time_step)
    expected = g * (math.sin(angle) - friction * math.cos(angle))
    if math.tan(angle) < friction:
        moved = (downhill[:, None] * (motion.position[3] - motion.position[2]).mean(1)[:, None]).sum()
        assert abs(float(moved)) < 2e-3  # in a fifth of a second, in which it would fall by 0.2 m
    else:
        assert acceleration == pytest.approx(expected, rel=0.02)


MOVING = {
    "sphere": (Collider.sphere((0.0, -0.22, 0.02), 0.1, friction=0.4), (0.0, -2.0, 0.0)),
    "piston": (Collider.plane((-0.2, 0.0, 0.0), (1.0, 0.0, 0.0), velocity=(3.0, 0.0, 0.0)), (0.0, 0.0, 0.0)),
    "rotating box": (
        Collider.box((-0.5, -0.3, -0.5), (0.5, -0.12, 0.5), spin=(0.0, 2.0, 1.0), friction=0.5),
        (0.0, -1.0, 0.0),
    ),
    "sticky": (Collider.sphere((0.0, -0.22, 0.02), 0.1, contact="sticky", end=0.04), (0.0, -2.0, 0.0)),
    "slip": (Collider.sphere((0.0, -0.22, 0.02), 0.1, contact="slip"), (0.0, -2.0, 0.0)),
}


@pytest.mark.parametrize(
    ("case", "backend"),
    [
        *(pytest.param(case, "torch", marks=pytest.mark.slow if case in ("piston", "slip") else ()) for case in MOVING),
        *((case, "auto") for case in MOVING),
    ],
)
def test_the_momentum_of_a_body_is_the_recorded_impulse(case: str, backend: str) -> None:
    momentum_is_impulse(case, backend, "apic")


@pytest.mark.parametrize("case", ["sphere", "sticky"])
def test_the_momentum_of_a_body_is_the_recorded_impulse_with_affine_xpic(case: str) -> None:
    momentum_is_impulse(case, "auto", "axpic3")


def momentum_is_impulse(case: str, backend: str, transfer: str) -> None:
    collider, velocity = MOVING[case]
    state = block()
    start = doubles(velocity)[:, None].expand_as(state.velocity)
    with using_backend(backend):
        settings = replace(settings_with(collider), transfer=transfer)
        motion = run(settings, state._replace(velocity=start.clone()), 100)
    given = (motion.velocity[-1] - start).sum(1) * 1000.0 * 0.2**3 / 64
    assert given.norm() > 0.5
    assert motion.impulses.shape == (2, 1, 1, 3)
    torch.testing.assert_close(motion.impulses[-1, 0, 0], given, rtol=0, atol=1e-12)


def in_contact() -> tuple[SimulationSettings, ParticleState]:
    """A body that slides over a plane, and what stands around it but for the plane."""
    state = block(0.0, 0.075)
    velocity = doubles([1.0, -1.0, 0.5])[:, None] + 0.1 * uniform(seeded(5), 3, 64)
    return settings_with(), state._replace(velocity=velocity)


def end_with(friction: Tensor, push: Tensor, recompute: bool = False) -> Tensor:
    """Where the body is after some steps on a plane with friction that moves up."""
    settings, state = in_contact()
    plane = Collider.plane((0.0, -0.01, 0.0), (0.1, 1.0, 0.0), friction=friction, velocity=push)
    simulator = analytic_simulator("elasticity", settings_with(plane))
    parameters = per_particle(PARAMETERS, 64)
    batch = SceneBatch(state, scene_of(settings.gravity), parameters)
    return differentiable_rollout(simulator, batch, 12, 12, recompute=recompute)[-1].mean(1)


@pytest.mark.parametrize("backend", ["torch", "auto"])
def test_derivatives_by_friction_and_velocity_are_those_of_finite_differences(backend: str) -> None:
    mu, push = doubles(0.2).requires_grad_(), doubles([0.1, 0.3, 0.0]).requires_grad_()
    with using_backend(backend):
        slopes = [torch.autograd.grad(x, (mu, push), retain_graph=True) for x in end_with(mu, push)]
        again = [torch.autograd.grad(x, (mu, push)) for x in end_with(mu, push, recompute=True)[:1]]
        torch.testing.assert_close(again[0], slopes[0], rtol=1e-12, atol=1e-15)
        with torch.no_grad():
            step = 1e-6
            of_mu = (end_with(mu + step, push) - end_with(mu - step, push)) / (2 * step)
            by_x = doubles([step, 0.0, 0.0])
            of_push = (end_with(mu, push + by_x) - end_with(mu, push - by_x)) / (2 * step)
        with forward_ad.dual_level(), torch.no_grad():
            dual = forward_ad.make_dual(mu.detach(), doubles(1.0))
            rate = forward_ad.unpack_dual(end_with(dual, push.detach())).tangent
    found = torch.stack([slope[0] for slope in slopes])
    assert found.abs().max() > 1e-4
    torch.testing.assert_close(found, of_mu, rtol=1e-6, atol=1e-9)
    torch.testing.assert_close(torch.stack([slope[1][0] for slope in slopes]), of_push, rtol=1e-6, atol=1e-9)
    assert rate is not None
    torch.testing.assert_close(rate, found, rtol=1e-10, atol=1e-14)


@pytest.mark.parametrize("backend", ["torch", "auto"])
def test_the_walls_of_the_box_as_planes_are_the_walls_to_the_last_bit(backend: str) -> None:
    walls = SimulationSettings()
    sides = [(axis, side) for axis in range(3) for side in (0, 1)]
    planes = []
    for axis, side in sides:
        point, normal = [0.5, 0.5, 0.5], [0.0, 0.0, 0.0]
        point[axis], normal[axis] = (0.9, -1.0) if side else (0.1, 1.0)
        planes.append(Collider.plane(point, normal))
    without = SimulationSettings(domain=None, colliders=tuple(planes))
    generator = seeded(8)
    position = 0.12 + 0.1 * uniform(generator, 3, 64)
    state = ParticleState.at_rest_shape(position, 2.0 * uniform(generator, 3, 64))
    found = []
    with using_backend(backend):
        for settings in (walls, without):
            motion = run(settings, state, 60, Skips.none())
            found.append((motion.position[-1], motion.velocity[-1]))
    for ours, theirs in zip(*found, strict=True):
        if backend == "torch":
            assert torch.equal(ours, theirs)
        else:  # the kernel rounds once where PyTorch rounds twice
            torch.testing.assert_close(ours, theirs, rtol=0, atol=1e-12)


def test_a_function_of_position_and_time_acts_as_the_shape_that_it_describes() -> None:
    sphere = Collider.sphere((0.0, -0.22, 0.02), 0.1, friction=0.4, velocity=(0.0, 1.0, 0.0))

    def distance(position: Tensor, time: float) -> Tensor:
        centre = position.new_tensor([0.0, -0.22 + time, 0.02])
        return (position - centre).norm(dim=1) - 0.1

    custom = Collider.signed_distance(distance, friction=0.4, velocity=(0.0, 1.0, 0.0))
    state = block()
    ends = [run(settings_with(collider), state, 100).position[-1] for collider in (sphere, custom)]
    assert (ends[0] - state.position).norm(dim=0).min() > 1e-3
    torch.testing.assert_close(ends[1], ends[0], rtol=0, atol=1e-12)


def test_the_compiled_step_with_colliders_equals_that_of_pytorch() -> None:
    collider = MOVING["rotating box"][0]
    settings = settings_with(collider, MOVING["sphere"][0], gravity=(0.0, -9.8, 0.0))
    simulator = analytic_simulator("elasticity", settings)
    generator = seeded(4)
    strained = block().deformation + 0.05 * uniform(generator, 3, 3, 64)
    start = block()._replace(deformation=strained, velocity=uniform(generator, 3, 64))
    found = []
    for backend in ("torch", "auto"):
        state = ParticleState(*(field.clone().requires_grad_() for field in start))
        with using_backend(backend):
            parameters = per_particle(PARAMETERS, 64)
            after = simulator(state, scene_of(settings.gravity), parameters, step=3)
            after = simulator(after, scene_of(settings.gravity), parameters, step=4)
            weights = [uniform(seeded(2), *field.shape) for field in after[:4]]
            found.append([*after[:4], *torch.autograd.grad(after[:4], state[:4], weights)])
    for ours, theirs in zip(*found, strict=True):
        torch.testing.assert_close(ours, theirs, rtol=1e-11, atol=1e-12 * max(1.0, float(theirs.detach().abs().max())))


@pytest.mark.parametrize(
    ("options", "fault"),
    [
        ({"shape": "spher", "centre": CENTRE, "radius": 0.1}, "did you mean 'sphere'"),
        ({"shape": "sphere", "centre": CENTRE, "radius": 0.1, "fricton": 1}, "did you mean 'friction'"),
        ({"shape": "sphere", "centre": CENTRE}, "needs radius"),
        ({"shape": "sphere", "centre": CENTRE, "radius": -1.0}, "radius=-1.0 is out of range"),
        ({"shape": "plane", "point": CENTRE, "normal": (0, 0, 0)}, "a direction"),
        ({"shape": "plane", "point": (0, 1), "normal": (0, 1, 0)}, "three finite numbers"),
        ({"shape": "plane", "point": CENTRE, "normal": (0, 1, 0), "contact": "stick"}, "did you mean 'sticky'"),
        (
            {"shape": "plane", "point": CENTRE, "normal": (0, 1, 0), "contact": "slip", "friction": 0.2},
            "no effect beside",
        ),
        ({"shape": "plane", "point": CENTRE, "normal": (0, 1, 0), "friction": -0.2}, "from 0"),
        ({"shape": "box", "low": CENTRE, "high": CENTRE}, "is not below"),
        ({"shape": "plane", "point": CENTRE, "normal": (0, 1, 0), "start": 2, "end": 1}, "a later time"),
    ],
)
def test_wrong_colliders_are_refused_in_one_line(options: dict[str, object], fault: str) -> None:
    with pytest.raises(UserError, match="^scene.colliders") as refused:
        Collider.from_options(options, "scene.colliders[0]")
    assert fault in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("function", "fault"),
    [
        (lambda x, _: x[:, 1] * float("nan"), r"its distance at \(0.4.*\) m is not finite"),
        (lambda x, _: torch.ones(len(x)).double(), "does not depend on the positions"),
        (lambda x, _: x.height, "the function fails: AttributeError: 'Tensor' object has no attribute 'height'"),
        (lambda _, time: time, r"the function gave float; accepted: a tensor of \("),
    ],
)
def test_functions_that_give_no_distance_are_refused_in_one_line(
    function: Callable[[Tensor, float], Any], fault: str
) -> None:
    body, collider = pc.Body.cube(side=0.2, particles_per_edge=4), pc.Collider.signed_distance(function)
    with pytest.raises(UserError, match=fault):
        pc.Scene(body, pc.analytic_law("sand"), colliders=[collider])


def test_options_of_a_collider_make_it_again() -> None:
    collider = Collider.capsule(CENTRE, (0, 0, 0), 0.2, friction=0.3, spin=(0, 1, 0), start=0.1, end=2.0)
    assert Collider.from_options(collider.to_options()) == collider
    assert collider != Collider.capsule(CENTRE, (0, 0, 0), 0.2)
