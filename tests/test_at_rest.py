"""A scene that has come to rest is left alone, and one that only pauses is not."""

from collections.abc import Callable
from dataclasses import replace

import pytest
import torch
from bodies import EARTH, NO_GRAVITY, one_scene
from falling_bodies import ON, PARTICLES, SIDE, analytic, batch, body, run

from pcnclaws.at_rest import SLOW, TOLERANCE, WINDOW, RestWatch
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.recording import FramePlan

SETTINGS = SimulationSettings(time_step=5e-4, grid_nodes=8, boundary="stick")
STEPS = 2000
ALWAYS = replace(ON, rest=False)


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


def rests_at(
    speed: Callable[[float], float], gravity: tuple[float, float, float] = EARTH, seconds: float = 0.5
) -> float | None:
    """When a scene of that speed [m/s] is found to rest [s]."""
    watch = RestWatch(SETTINGS, round(seconds / SETTINGS.time_step))
    state = body((0.5, 0.5, 0.5), (0.0, 0.0, 0.0))
    for n in watch.looks:
        state.velocity[2, 11] = speed(n * SETTINGS.time_step)
        if watch.resting(n, (4,), state, one_scene(PARTICLES, 1.0, gravity=gravity)):
            return n * SETTINGS.time_step
    return None


@pytest.mark.parametrize("gravity", [EARTH, NO_GRAVITY])
def test_what_is_slow_for_the_window_rests(gravity: tuple[float, float, float]) -> None:
    found = rests_at(lambda t: 0.5 * SLOW if t > 0.1 else 1.0, gravity)
    assert found is not None
    assert 0.1 + WINDOW <= found <= 0.1 + 1.5 * WINDOW


def test_the_slower_the_longer_it_still_has_to_stay() -> None:
    assert rests_at(lambda t: 0.9 * SLOW, seconds=0.5) is not None
    found = rests_at(lambda t: 0.9 * SLOW, seconds=5.0)
    assert found is not None
    assert 0.9 * SLOW * (5.0 - found) < 0.5 * TOLERANCE * SETTINGS.grid_spacing


MOVING: dict[str, Callable[[float], float]] = {
    "too fast": lambda t: 1.1 * SLOW,
    "speeding up from rest": lambda t: 1e-4 * t,
    "slow every other moment": lambda t: 0.5 * SLOW if t % 0.04 < 0.02 else 1.0,
    "top of a flight": lambda t: 9.8 * abs(t - 0.25),
    "not a number": lambda t: float("nan"),
}


@pytest.mark.parametrize("motion", list(MOVING))
def test_what_moves_does_not_rest(motion: str) -> None:
    assert rests_at(MOVING[motion]) is None


def test_weak_gravity_needs_a_longer_window() -> None:
    weak = (0.0, -1e-3, 0.0)
    assert rests_at(lambda t: 1e-3 * abs(t - 0.25), weak) is None, "slow for 0.2 s at the top of its flight"
    assert rests_at(lambda t: 1e-3 * abs(t - 0.25), NO_GRAVITY) is not None
