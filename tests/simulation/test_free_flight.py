"""Segments of free flight, which are the same with every law: how they are told, and what is drawn instead."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from training_bodies import EVERY, SETTINGS, lifted, starts

from pcnclaws.data.dataset import SegmentDataset
from pcnclaws.data.segments import SegmentPlan
from pcnclaws.data.timeline import Timeline
from pcnclaws.errors import UserError
from pcnclaws.geometry.shapes import spin_velocity
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.simulation.execution import Execution
from pcnclaws.simulation.fast_paths import Skips
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.simulation.scenes import SceneStart

LAWS = analytic_laws(MATERIALS["elasticity"])
# The first two reach the floor, the third one does not.
LIFTS = (0.15, 0.3, 0.45)
STEPS = 160


def spinning(start: SceneStart, spin: float) -> SceneStart:
    """The body spinning about a level axis [rad/s]."""
    velocity = spin_velocity(start.position, start.velocity, [spin, 0.0, 0.0], start.position.mean(0).tolist())
    return replace(start, velocity=velocity)


def recorded_without_help(scenes: Sequence[SceneStart], steps: int = STEPS) -> list[SceneRecord]:
    """Motions of which every step is computed, in single precision."""
    return simulate_records(scenes, LAWS, FramePlan(steps, EVERY), Execution(skips=Skips.none()))


@pytest.fixture(scope="module")
def falls() -> list[SceneRecord]:
    return recorded_without_help([lifted(start, lift) for lift, start in zip(LIFTS, starts(3), strict=True)])


def free_flight(record: SceneRecord) -> int | None:
    return Timeline(record, "initial").free_flight(EVERY)


def test_a_falling_body_shows_nothing_before_it_feels_a_wall(falls: list[SceneRecord]) -> None:
    *landing, in_the_air = falls
    for fall in landing:
        contact = free_flight(fall)
        lowest = fall.position[0, :, 1].min() - 1.5e-3 * np.arange(STEPS) - 4.9e-6 * np.arange(STEPS) ** 2
        reached = int(np.argmax(lowest < SETTINGS.wall_distance + 1.5 * SETTINGS.grid_spacing))
        assert contact is not None
        # the first cell of its stencil meets the floor with hardly any weight
        assert reached <= contact <= reached + 15
    assert free_flight(in_the_air) is None


def test_a_free_body_at_rest_or_at_constant_velocity_shows_nothing_but_a_spinning_one_does() -> None:
    weightless = replace(SETTINGS, gravity=(0.0, 0.0, 0.0))
    start = replace(lifted(starts(1, weightless)[0], 0.2), velocity=np.tile([0.2, 0.0, 0.1], (64, 1)))
    still = replace(start, velocity=np.zeros((64, 3)))
    moving, resting, turning = recorded_without_help([start, still, spinning(start, 2.0)], 100)
    assert free_flight(moving) is None
    assert free_flight(resting) is None
    assert free_flight(turning) == EVERY


def test_a_body_that_lies_on_the_floor_shows_that_it_is_held() -> None:
    lying = replace(starts(1)[0], velocity=np.zeros((64, 3)))
    lying = replace(lying, position=lying.position - np.array([0.0, 0.09, 0.0]))
    assert free_flight(recorded_without_help([lying], 20)[0]) == EVERY


def test_scenes_are_drawn_from_the_step_on_that_ends_their_free_flight(falls: list[SceneRecord]) -> None:
    early, late = (free_flight(fall) for fall in falls[:2])
    assert early is not None
    assert late is not None
    dataset = SegmentDataset(falls, SegmentPlan(40, 1, "initial", first=20, last=STEPS))
    batches = [dataset[iteration] for iteration in range(40)]
    assert batches[0].steps == early, "longer than planned: shorter ones would show nothing"
    assert batches[-1].steps == STEPS
    drawn = {(batch.steps, round(float(batch.start.parameters["youngs_modulus"][0]))) for batch in batches}
    moduli = [round(fall.parameters["youngs_modulus"]) for fall in falls]
    assert {modulus for steps, modulus in drawn if steps < late} == {moduli[0]}
    assert {modulus for steps, modulus in drawn if steps >= late} == set(moduli[:2])
    assert len(dataset.notes) == 2
    lengthened, left_out = dataset.notes[0], dataset.notes[-1]
    assert f"segments begin with {early} steps instead of 20" in lengthened
    assert "free flight alone for 160 steps: body_2" in left_out
    assert dataset.lengths == (early, STEPS)


def test_scenes_of_other_settings_are_drawn_when_they_show_something(falls: list[SceneRecord]) -> None:
    finer = replace(falls[2], settings=replace(SETTINGS, grid_spacing=1 / 16))
    dataset = SegmentDataset([falls[0], finer], SegmentPlan(20, 2, "initial", first=100, last=STEPS))
    assert {dataset[iteration].group for iteration in range(20)} == {0}


def test_a_short_recording_does_not_shorten_the_segments_of_the_others(falls: list[SceneRecord]) -> None:
    clip = replace(falls[1], time=falls[1].time[:5], position=falls[1].position[:5], velocity=None)
    dataset = SegmentDataset([falls[0], clip], SegmentPlan(2, 2, "initial", first=150, last=STEPS))
    assert [dataset[0].steps, dataset[1].steps] == [150, STEPS]


@pytest.mark.parametrize("keyframes", [True, False])
def test_a_training_of_free_flight_alone_is_refused_with_the_length_that_would_do(
    falls: list[SceneRecord], keyframes: bool
) -> None:
    contact, start = free_flight(falls[0]), "keyframes" if keyframes else "initial"
    with pytest.raises(UserError, match=rf"training.segment_length.last=40 .*from {contact}, when scene 'body_0'"):
        SegmentDataset(falls, SegmentPlan(5, 2, start, first=20, last=40))
    with pytest.raises(UserError, match="free flight from beginning to end.*recordings that go on"):
        SegmentDataset(falls[2:], SegmentPlan(5, 2, start, first=20, last=40))
    assert len(SegmentDataset(falls, SegmentPlan(0, 2, start, first=20, last=40))) == 0


def test_segments_from_keyframes_are_drawn_from_the_whole_motion() -> None:
    high = simulate_records([lifted(starts(1)[0], 0.1)], LAWS, FramePlan(120, EVERY, keyframe_every=10))
    assert free_flight(high[0]) is not None
    dataset = SegmentDataset(high, SegmentPlan(40, 1, first=10, last=10))
    moving = {round(float(dataset[iteration].start.state.velocity[1].mean()), 2) for iteration in range(40)}
    assert len(moving) > 8, "free fall included"
    assert dataset.notes == ()


def test_unobserved_particles_do_not_look_like_free_flight_or_its_end(falls: list[SceneRecord]) -> None:
    position = falls[0].position.copy()
    position[1:, ::2] = np.nan
    assert free_flight(replace(falls[0], position=position)) == free_flight(falls[0])
    position[1:] = np.nan
    assert free_flight(replace(falls[0], position=position)) is None


def test_the_standard_setting_has_its_own_rounding() -> None:
    """500 steps of 5e-4 s through the air of a box without gravity."""
    settings = SimulationSettings(gravity=(0.0, 0.0, 0.0))
    start = replace(lifted(starts(1, settings)[0], 0.1), velocity=np.tile([0.07, 0.11, -0.13], (64, 1)))
    assert free_flight(recorded_without_help([start], 500)[0]) is None
