"""A scene that has come to rest is left alone, and one that only pauses is not."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch
from bodies import EARTH, NO_GRAVITY, one_scene
from falling_bodies import ON, PARTICLES, SIDE, analytic, batch, body, run

from pcnclaws.mpm.contact import VERSION_1_STICK
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.mpm.state import ParticleState, Scenes
from pcnclaws.simulation.at_rest import SLOW, TOLERANCE, WINDOW, RestWatch
from pcnclaws.simulation.recording import FramePlan

SETTINGS = SimulationSettings(time_step=5e-4, grid_spacing=1 / 8, boundary=VERSION_1_STICK)
STEPS = 2000
ALWAYS = replace(ON, rest=False)


@pytest.mark.slow
def test_scenes_that_come_to_rest_stay_where_they_would_have_stayed() -> None:
    heights = (0.2, 0.25)
    bodies = batch(*(body((0.5, 0.5 * SIDE + height, 0.5), (0.0, -0.2, 0.0)) for height in heights))
    bodies.parameters["youngs_modulus"][:] = 5e5
    simulator = analytic(settings=SETTINGS)
    plan = FramePlan(STEPS, every=20, keyframe_every=100, velocities=True)
    rested, full = run(simulator, bodies, plan), run(simulator, bodies, plan, ALWAYS)
    difference = (rested.position - full.position).norm(dim=1).max()
    assert 0.0 < difference <= TOLERANCE * SETTINGS.grid_spacing
    firsts = []
    for scene in range(len(heights)):
        part = slice(scene * PARTICLES, (scene + 1) * PARTICLES)
        still = (rested.position[1:, :, part] == rested.position[:-1, :, part]).flatten(1).all(1)
        firsts.append(int(still.nonzero()[0]))
        assert still[firsts[-1] :].all(), "once at rest, always at rest"
        assert full.velocity[firsts[-1], :, part].norm(dim=0).max() < SLOW
    assert 60 < firsts[0] < firsts[1] < 98, "each scene leaves when it is still"
    assert torch.equal(rested.deformation[-1], rested.deformation[-2])
    torch.testing.assert_close(rested.deformation[-1], full.deformation[-1], atol=1e-3, rtol=0)


def test_a_body_at_the_top_of_its_flight_goes_on() -> None:
    bodies = batch(body((0.5, 0.5, 0.5), (0.0, 0.49, 0.0)))
    plan = FramePlan(150, every=1, velocities=True)
    simulator = analytic(settings=SETTINGS)
    thrown = run(simulator, bodies, plan, replace(ON, free_fall=False))
    assert thrown.velocity.norm(dim=1).amax(1).min() < 1e-6, "it pauses in one of the frames"
    assert torch.equal(thrown.position, run(simulator, bodies, plan, replace(ALWAYS, free_fall=False)).position)


def rests_at(velocity: Callable[[float], float], seconds: float = 0.5) -> float | None:
    """When a scene of which one particle has that velocity [m/s] is found to rest [s]."""
    watch = RestWatch(SETTINGS, round(seconds / SETTINGS.time_step))
    state = body((0.5, 0.5, 0.5), (0.0, 0.0, 0.0))
    for n in watch.looks:
        state.velocity[2, 11] = velocity(n * SETTINGS.time_step)
        if watch.resting(n, (4,), state, one_scene(PARTICLES, 1.0, gravity=EARTH)):
            return n * SETTINGS.time_step
    return None


def test_what_is_slow_for_the_window_rests() -> None:
    found = rests_at(lambda t: 0.5 * SLOW if t > 0.1 else 1.0)
    assert found is not None
    assert 0.1 + WINDOW <= found <= 0.1 + 2.0 * WINDOW


def test_the_slower_the_longer_it_still_has_to_stay() -> None:
    assert rests_at(lambda t: 0.9 * SLOW, seconds=0.5) is not None
    found = rests_at(lambda t: 0.9 * SLOW, seconds=5.0)
    assert found is not None
    assert 0.9 * SLOW * (5.0 - found) < TOLERANCE * SETTINGS.grid_spacing


MOVING: dict[str, Callable[[float], float]] = {
    "too fast": lambda t: 1.1 * SLOW,
    "speeding up from rest": lambda t: 1e-4 * t,
    "slow every other moment": lambda t: 0.5 * SLOW if t % 0.04 < 0.02 else 1.0,
    "top of a flight": lambda t: 9.8 * (t - 0.25),
    "top of a flight under weak gravity": lambda t: 1e-3 * (t - 0.25),
    "seen at equal distances at its turning points": lambda t: math.sin(math.pi * t / 0.005),
    "not a number": lambda t: float("nan"),
}


@pytest.mark.parametrize("motion", list(MOVING))
def test_what_moves_does_not_rest(motion: str) -> None:
    assert rests_at(MOVING[motion]) is None


@pytest.mark.parametrize("period", 0.005 * 2.0 ** np.arange(0, 13, 3))
def test_a_vibration_of_any_period_stays_within_the_promise(period: float) -> None:
    """Particles, each a scene, that vibrate with many amplitudes and phases."""
    seconds, rate = 2.0, 2.0 * math.pi / period
    amplitude, phase = (
        torch.tensor(x).flatten() for x in np.meshgrid(10.0 ** np.arange(-10, -2, 0.75), [0, 0.8, 1.5, 2.4])
    )
    count = len(phase)
    watch = RestWatch(SETTINGS, round(seconds / SETTINGS.time_step))
    scenes = Scenes(torch.arange(count), torch.ones(count), torch.ones(count), torch.zeros(3, count))
    found: dict[int, float] = {}
    for n in watch.looks:
        velocity = torch.zeros(3, count, dtype=torch.float64)
        velocity[1] = amplitude * rate * torch.cos(rate * n * SETTINGS.time_step + phase)
        state = ParticleState.at_rest_shape(torch.zeros_like(velocity), velocity)
        for number in watch.resting(n, tuple(range(count)), state, scenes):
            found.setdefault(number, n * SETTINGS.time_step)
    assert found, "small ones rest"
    for number, since in found.items():
        t = torch.arange(since, seconds, SETTINGS.time_step)
        place = amplitude[number] * torch.sin(rate * t + phase[number])
        assert (place - place[0]).abs().max() <= TOLERANCE * SETTINGS.grid_spacing, (amplitude[number], phase[number])


@pytest.mark.parametrize(("stiffness", "seconds"), [(10.0, 6.0), (100.0, 3.0)])
def test_a_soft_body_without_weight_goes_on_beyond_its_turning_points(stiffness: float, seconds: float) -> None:
    settings = SimulationSettings(1e-2, 1 / 12, gravity=NO_GRAVITY)
    bodies = batch(body((0.5, 0.5, 0.5), NO_GRAVITY), gravity=[NO_GRAVITY])
    bodies.parameters["youngs_modulus"][:] = stiffness
    bodies.parameters["poissons_ratio"][:] = 0.0
    x = bodies.state.position[0]
    bodies.state.velocity[0] = 6e-4 * torch.cos(math.pi * (x - x.min()) / (x.max() - x.min()))
    plan = FramePlan(round(seconds / settings.time_step), every=10)
    simulator = analytic(settings=settings)
    difference = run(simulator, bodies, plan).position - run(simulator, bodies, plan, ALWAYS).position
    assert difference.norm(dim=1).max() <= TOLERANCE * settings.grid_spacing
