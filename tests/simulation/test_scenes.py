"""Scenes to batches and back, and where a scene may start."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from recordings import SAND, recording

from pcnclaws.errors import SimulationDiverged, UserError
from pcnclaws.geometry.shapes import particles, spin_velocity
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.materials import material_named
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.simulation.batch import batch_scenes
from pcnclaws.simulation.execution import Execution
from pcnclaws.simulation.placement import require_inside
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.scenes import SceneStart, group_by_settings, start_of
from pcnclaws.tensors.layout import join_positions, split_vectors

SETTINGS = SimulationSettings()


def _start(name: str, settings: SimulationSettings = SETTINGS, edge: int = 4, **parameters: float) -> SceneStart:
    body = particles(particles_per_edge=edge)
    velocity = spin_velocity(body.position, body.velocity + np.array((0.5, -2.0, 0.0)), (0.0, 3.0, 1.0))
    return SceneStart(name, "sand", settings, {**SAND, **parameters}, body.position, velocity, body.volume)


def test_a_batch_holds_each_scene_and_gives_it_back() -> None:
    light = replace(SETTINGS, density=500.0, gravity=(0.0, 0.0, 1.0))
    starts = [_start("a"), _start("b", light, 3, friction_angle=20.0)]
    batch = batch_scenes(starts, torch.float64)
    assert batch.names == ("a", "b")
    assert batch.particle_counts == [64, 27]
    assert batch.parameters["friction_angle"][[0, 63, 64, 90]].tolist() == [30.0, 30.0, 20.0, 20.0]
    assert batch.scenes.gravity.T.tolist() == [[0.0, -9.8, 0.0], [0.0, 0.0, 1.0]]
    np.testing.assert_allclose(batch.scenes.mass[64:], 500.0 * starts[1].volume)
    for start, position in zip(starts, split_vectors(batch.state.position[None], batch.particle_counts), strict=True):
        np.testing.assert_array_equal(position[0], start.position)
    joined = join_positions([start.position[None] for start in starts], torch.float64)
    torch.testing.assert_close(joined[0], batch.state.position, rtol=0.0, atol=0.0)


def test_a_recorded_full_state_starts_with_its_deformation() -> None:
    record = recording()
    batch = batch_scenes([start_of(record), start_of(recording(keyframes=False))])
    assert record.keyframes is not None
    np.testing.assert_array_equal(batch.state.deformation[:, :, 3].numpy(), record.keyframes.deformation[0, 3])
    np.testing.assert_array_equal(batch.state.deformation[:, :, 8].numpy(), np.eye(3, dtype=np.float32))
    assert not batch.state.affine[:, :, 5:].any()


def test_scenes_that_cannot_share_a_batch_are_grouped() -> None:
    fine = _start("fine", replace(SETTINGS, grid_spacing=1 / 32))
    starts = [_start("a"), fine, _start("b", replace(SETTINGS, density=1.0))]
    assert [[start.name for start in group] for group in group_by_settings(starts)] == [["a", "b"], ["fine"]]
    with pytest.raises(ValueError, match="same settings"):
        batch_scenes(starts)


def test_scenes_of_different_settings_come_back_in_order_and_equal_to_separate_runs() -> None:
    laws = analytic_laws(material_named("sand"))
    starts = [_start("a"), _start("fine", replace(SETTINGS, grid_spacing=1 / 32)), _start("b", youngs_modulus=2e5)]
    together = simulate_records(starts, laws, FramePlan(20, 5, 10), Execution(torch.float64))
    assert [record.name for record in together] == ["a", "fine", "b"]
    for start, record in zip(starts, together, strict=True):
        alone = simulate_records([start], laws, FramePlan(20, 5, 10), Execution(torch.float64))[0]
        np.testing.assert_allclose(record.position, alone.position, atol=1e-7)
        assert record.frame_steps().tolist() == [0, 5, 10, 15, 20]
        assert record.settings == start.settings
        assert record.keyframes is not None
        assert record.keyframes.step.tolist() == [0, 10, 20]
        np.testing.assert_array_equal(record.keyframes.position[1], record.position[2])


def test_a_recording_goes_on_from_its_keyframe() -> None:
    laws = analytic_laws(material_named("sand"))
    whole = simulate_records([_start("a")], laws, FramePlan(40, 5, 20))[0]
    assert whole.keyframes is not None
    state = {name: getattr(whole.keyframes, name)[1] for name in ("position", "velocity", "affine", "deformation")}
    rest = simulate_records([replace(_start("a"), **state)], laws, FramePlan(20, 5))[0]
    np.testing.assert_array_equal(rest.position, whole.position[4:])


def test_a_scene_that_diverges_is_named() -> None:
    unstable = replace(SETTINGS, time_step=0.02)
    calm = replace(_start("calm", unstable), velocity=np.zeros((64, 3)))
    starts = [calm, _start("wild", unstable, youngs_modulus=1e9)]
    with pytest.raises(SimulationDiverged, match="scene 'wild' diverged at step"):
        simulate_records(starts, analytic_laws(material_named("sand")), FramePlan(100, 1))


@pytest.mark.parametrize(
    ("coordinate", "message"),
    [
        (-0.01, "outside the domain"),
        (1.01, "outside the domain"),
        (0.05, "inside the wall layer"),
        (0.91, "inside the wall layer"),
        (float("nan"), "outside the domain"),
    ],
)
def test_particles_must_start_between_the_walls(coordinate: float, message: str) -> None:
    position = particles(particles_per_edge=3).position
    position[5, 1] = coordinate
    with pytest.raises(UserError, match=rf"^scene\.particles=x: particle 5 at .*{message}.*from 0\.1 to 0\.9 m"):
        require_inside(position, SETTINGS, "scene.particles=x")


def test_particles_may_touch_the_wall_layer() -> None:
    position = particles(side=0.8, particles_per_edge=3).position
    require_inside(position, SETTINGS, "scene")
    require_inside(position.astype(np.float32), SETTINGS, "scene")


def test_a_record_that_does_not_say_how_it_starts_is_refused() -> None:
    with pytest.raises(UserError, match=r"scene 'thrown': has no initial_velocity"):
        start_of(replace(recording(), initial_velocity=None))
    with pytest.raises(UserError, match=r"parameters\.friction_angle is missing"):
        start_of(replace(recording(), parameters={"youngs_modulus": 1e5, "poissons_ratio": 0.2}))
    assert start_of(replace(recording(), material="my own rubber", parameters={})).material == "my own rubber"
