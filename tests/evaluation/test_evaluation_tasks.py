"""The built-in tasks of the evaluation: which scenes they hold, and the measures that go with them."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from recorded_scenes import SAND, recorded, small_cube, softer_sand

from pcnclaws.data.sampling import DataSetPlan
from pcnclaws.errors import UserError
from pcnclaws.evaluate import evaluate
from pcnclaws.evaluation.builtin import TASKS, BuiltinTask, builtin_task, true_records
from pcnclaws.evaluation.divergence import DivergedScene, survivors
from pcnclaws.evaluation.energy import energy_error
from pcnclaws.evaluation.floor import floor
from pcnclaws.evaluation.frames import in_time_step
from pcnclaws.evaluation.gallery import leave_map
from pcnclaws.evaluation.parameter_map import error_maps, map_axis, map_settings, map_starts
from pcnclaws.evaluation.report import metrics, results_table
from pcnclaws.evaluation.tasks import SceneResult, evaluate_records
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.laws.parameters import validate_parameters
from pcnclaws.metrics import object_size
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.rendering.maps import MapAxis, cell_edges
from pcnclaws.simulation.execution import Execution
from pcnclaws.simulation.law_simulator import LawSimulator
from pcnclaws.simulation.placement import require_inside
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.simulation.scenes import SceneStart
from pcnclaws.simulation.time_step import stability_of, stable_cfl

ANALYTIC = LawSimulator(analytic_laws(MATERIALS["sand"]))
SAND_PLAN = DataSetPlan(MATERIALS["sand"])
UP = np.array([0.0, 1.0, 0.0], np.float32)
SAND_DEFAULTS = MATERIALS["sand"].defaults


@pytest.fixture(scope="module")
def record() -> SceneRecord:
    """A sand cube that meets the floor, with keyframes every 10 of 40 steps."""
    return recorded(small_cube("a"), steps=40)[0]


def cfl(start: SceneStart) -> float:
    return stability_of(start).cfl


def spin_of(start: SceneStart) -> np.ndarray:
    """Angular velocity [rad/s] of a body that moves rigidly, from v = v_0 + omega x r."""
    offset = start.position - start.position.mean(0)
    turning = start.velocity - start.velocity.mean(0)
    inertia = np.square(offset).sum() * np.eye(3) - offset.T @ offset
    return np.linalg.solve(inertia, np.cross(offset, turning).sum(0))


@pytest.mark.parametrize("material", sorted(MATERIALS))
@pytest.mark.parametrize("task", sorted(TASKS))
def test_every_scene_of_every_task_can_be_simulated(task: str, material: str) -> None:
    found = builtin_task(task, MATERIALS[material])
    assert len({start.name for start in found.starts}) == len(found.starts) >= 3
    assert (
        found.plan.steps % found.plan.every
        == found.plan.steps % found.plan.keyframe_every
        == found.plan.keyframe_every % found.plan.every
        == 0
    )
    for start in found.starts:
        assert set(start.name) <= set("abcdefghijklmnopqrstuvwxyzETUY0123456789._-")
        validate_parameters(start.parameters, MATERIALS[material].parameter_names)
        require_inside(start.position, start.settings, start.name)
        assert cfl(start) < stable_cfl(material, start.parameters["poissons_ratio"])


def test_the_long_term_is_twice_the_training() -> None:
    long, training = (builtin_task(name, MATERIALS["sand"]) for name in ("long_term", "reconstruction"))
    assert long.plan.steps == 2 * training.plan.steps == 1000
    for one, other in zip(long.starts, training.starts, strict=True):
        assert one.parameters == other.parameters
        np.testing.assert_array_equal(one.velocity, other.velocity)


def test_geometries_are_six_bodies_of_known_parameters() -> None:
    known = builtin_task("reconstruction", MATERIALS["sand"]).starts
    found = builtin_task("geometry", MATERIALS["sand"]).starts
    assert len(found) == 6
    assert [start.parameters for start in found] == [start.parameters for start in known[:6]]
    for start in found:
        assert start.name != "cube"
        assert 1000 <= len(start.position) <= 10_000
        assert 0.2 < object_size(start.volume) < 0.5
        assert 1.0 <= 0.05**3 / start.volume[0] <= 8.5, "particles of a cell of the grid"


def test_unseen_motions_are_no_motions_of_the_training_and_two_are_faster_than_any() -> None:
    known = builtin_task("reconstruction", MATERIALS["sand"]).starts
    found = builtin_task("unseen_motion", MATERIALS["sand"]).starts
    for start in found:
        assert start.parameters in [other.parameters for other in known]
        assert min(np.abs(start.velocity - other.velocity).max() for other in known) > 0.1
    speeds = [np.linalg.norm(start.velocity.mean(0)) for start in found]
    spins = [np.linalg.norm(spin_of(start)) for start in found]
    assert speeds[-2:] == pytest.approx([4.0, 4.0])
    assert spins[-2:] == pytest.approx([6.0, 6.0])
    assert max(np.linalg.norm(other.velocity.mean(0)) for other in known) < 3.01
    assert max(np.linalg.norm(spin_of(other)) for other in known) < 4.01


@pytest.mark.parametrize("task", ["reconstruction", "long_term"])
def test_a_law_of_one_scene_is_tested_on_the_motion_of_that_scene_alone(task: str) -> None:
    whole, own = (builtin_task(task, MATERIALS["sand"], scene) for scene in (None, "train-03"))
    assert [start.name for start in own.starts] == ["train-03"]
    assert own.plan == whole.plan
    np.testing.assert_array_equal(own.starts[0].velocity, whole.starts[3].velocity)


@pytest.mark.parametrize("material", sorted(MATERIALS))
@pytest.mark.parametrize("task", ["geometry", "unseen_motion"])
def test_a_law_of_one_scene_is_tested_with_the_parameters_of_that_scene(task: str, material: str) -> None:
    whole = builtin_task(task, MATERIALS[material])
    for known in builtin_task("reconstruction", MATERIALS[material]).starts:
        own = builtin_task(task, MATERIALS[material], known.name)
        assert [start.name for start in own.starts] == [start.name for start in whole.starts]
        for one, other in zip(own.starts, whole.starts, strict=True):
            assert one.parameters == known.parameters
            np.testing.assert_array_equal(one.velocity, other.velocity)
            assert cfl(one) < stable_cfl(material, one.parameters["poissons_ratio"])


def test_scenes_that_are_not_there_and_tasks_without_them_are_refused() -> None:
    with pytest.raises(UserError, match=r"task\.scene='trian-03' .*did you mean 'train-03'"):
        builtin_task("geometry", MATERIALS["sand"], "trian-03")
    with pytest.raises(UserError, match="does not go with task=unseen"):
        builtin_task("unseen", MATERIALS["sand"], "train-03")


def test_the_resolution_is_finer_at_the_same_times() -> None:
    finer, standard = (builtin_task(name, MATERIALS["sand"]) for name in ("resolution", "unseen"))
    settings = finer.starts[0].settings
    assert settings == SimulationSettings(time_step=2.5e-4, grid_spacing=1 / 32, wall_distance=0.1)
    assert len(finer.starts[0].position) == 16**3
    assert [start.name for start in finer.starts] == [start.name for start in standard.starts]
    for name in ("steps", "every", "keyframe_every"):
        assert getattr(finer.plan, name) == 2 * getattr(standard.plan, name)


@pytest.mark.parametrize("material", ["elasticity", "plasticine", "sand"])
def test_the_map_reaches_far_beyond_the_ranges_with_one_comfortable_time_step(material: str) -> None:
    known = MATERIALS[material]
    found = builtin_task("outside_range", known)
    pairs = len(known.ranges) * (len(known.ranges) - 1) // 2
    assert len(found.starts) == 36 * pairs
    assert found.may_diverge
    for name, (low, high) in known.ranges.items():
        values = [start.parameters[name] for start in found.starts]
        assert min(values) == pytest.approx(0.5 * low, rel=1e-3)
        assert max(values) == pytest.approx(0.48 if name == "poissons_ratio" else 2.0 * high, rel=1e-3)
    (settings,) = {start.settings for start in found.starts}
    parts, highest = 5e-4 / settings.time_step, max(map(cfl, found.starts))
    assert parts == pytest.approx(round(parts))
    assert highest < 0.4
    assert round(parts) == 1 or highest * parts / (round(parts) - 1) >= 0.4, "no shorter than needed"
    assert found.plan.every * settings.time_step == pytest.approx(2.5e-3)
    assert found.plan.steps * settings.time_step == pytest.approx(0.25)


def test_the_energy_error_is_none_of_a_law_that_is_right_and_some_of_another(record: SceneRecord) -> None:
    assert evaluate_records([record], ANALYTIC)[0].energy_error == 0.0
    wrong = evaluate_records([record], softer_sand())[0].energy_error
    assert wrong is not None
    assert 1e-4 < wrong < 0.2


def test_the_energy_error_is_relative_to_the_liveliest_true_state(record: SceneRecord) -> None:
    keyframes = record.keyframes
    assert keyframes is not None
    lifted = replace(record, keyframes=replace(keyframes, position=keyframes.position + np.float32(0.1) * UP))
    mass = 1000.0 * record.volume.sum()
    speed = np.square(keyframes.velocity).sum(2).mean(1)
    error = energy_error(record, lifted, ANALYTIC.elasticity)
    # elastic energy and that of the affine velocities are small beside the fall
    assert error == pytest.approx(mass * 9.8 * 0.1 / (0.5 * mass * speed.max()), rel=0.02)


def test_there_is_no_energy_error_without_full_states(record: SceneRecord) -> None:
    assert evaluate_records([replace(record, keyframes=None)], ANALYTIC)[0].energy_error is None
    (start,) = recorded(small_cube("a"), steps=40, keyframe_every=50)
    assert evaluate_records([start], ANALYTIC)[0].energy_error is None


def test_keyframes_keep_their_times_in_another_time_step(record: SceneRecord) -> None:
    assert record.keyframes is not None
    halved = in_time_step(record, 0.5 * record.settings.time_step)
    assert halved.keyframes is not None
    assert halved.keyframes.step.tolist() == [0, 20, 40, 60, 80]
    error = evaluate_records([halved], ANALYTIC)[0].energy_error
    assert error is not None
    assert 0.0 < error < 0.05
    between = in_time_step(record, 1.5 * record.settings.time_step)
    assert between.keyframes is not None
    assert between.keyframes.step.tolist() == [0, 20], "those that no step meets are left out"


def test_keyframes_between_the_frames_are_met_too(record: SceneRecord) -> None:
    sparse = replace(record, time=record.time[[0, -1]], position=record.position[[0, -1]], velocity=None)
    result = evaluate_records([sparse], ANALYTIC)[0]
    assert (result.mse, result.energy_error) == (0.0, 0.0)


def test_the_floor_is_that_of_rounding_and_of_the_time_step(record: SceneRecord) -> None:
    done: list[int] = []
    found = floor([record], Execution(progress=done.append))
    assert found["float64"] is not None
    assert found["half_step"] is not None
    assert 0.0 < found["float64"] < 1e-10 < found["half_step"] < 1e-5
    assert sum(done) == 2


def test_a_scene_that_diverges_does_not_end_the_others(record: SceneRecord) -> None:
    stiff = replace(record, name="stiff", parameters={**SAND, "youngs_modulus": 1e9})
    records = [record, stiff, replace(record, name="b")]
    done: list[int] = []
    outcomes = survivors(records, lambda some: evaluate_records(some, ANALYTIC), done.append)
    assert [outcome.name for outcome in outcomes] == ["a", "stiff", "b"]
    assert [isinstance(outcome, SceneResult) for outcome in outcomes] == [True, False, True]
    assert isinstance(outcomes[1], DivergedScene)
    assert "'stiff' diverged at step" in outcomes[1].message
    assert sum(done) == 3
    values = json.loads(json.dumps(metrics(outcomes)))
    assert values["mse"] == 0.0
    assert values["scenes"][1]["mse"] is None
    assert values["scenes"][1]["diverged"] == outcomes[1].message
    assert "mean, 1 diverged" in list(results_table(outcomes).columns[0].cells)
    alone = survivors([stiff], lambda some: evaluate_records(some, ANALYTIC))
    assert metrics(alone)["mse"] is None


def small_map(points: int = 2, steps: int = 40) -> BuiltinTask:
    settings = map_settings(SAND_PLAN.material, SAND_PLAN, points)
    return BuiltinTask(
        map_starts(SAND_PLAN.material, SAND_PLAN, settings, points), FramePlan(steps, 10, 20), may_diverge=True
    )


@pytest.mark.slow
def test_a_small_map_from_the_truth_to_the_picture(tmp_path: Path) -> None:
    task = small_map()
    done: list[int] = []
    truth = true_records(task, SAND_PLAN.material, Execution(progress=done.append))
    assert sum(done) == task.work == 12
    records = [scene for scene in truth if isinstance(scene, SceneRecord)]
    outcomes = evaluate_records(records, softer_sand())
    assert len(outcomes) == 12
    maps = error_maps(SAND_PLAN.material, {outcome.name: outcome.mse for outcome in outcomes}, points=2)
    assert [(one.across.name, one.up.name) for one in maps] == [
        ("youngs_modulus", "poissons_ratio"),
        ("youngs_modulus", "friction_angle"),
        ("poissons_ratio", "friction_angle"),
    ]
    for outcome in outcomes:
        place = [
            one.mse[row, column]
            for one in maps
            for row, up in enumerate(one.up.values)
            for column, across in enumerate(one.across.values)
            if {**SAND_DEFAULTS, one.across.name: across, one.up.name: up} == outcome.parameters
        ]
        assert outcome.mse in place


def test_the_map_shows_errors_and_hatches_what_diverged(record: SceneRecord, tmp_path: Path) -> None:
    result = evaluate_records([record], softer_sand())[0]
    material = MATERIALS["elasticity"]
    starts = builtin_task("outside_range", material).starts
    survived = [replace(result, true=replace(result.true, name=start.name)) for start in starts[:30]]
    diverged = [DivergedScene(start.name, start.parameters, "it left") for start in starts[30:]]
    paths = leave_map([*survived, *diverged], material, "elasticity", tmp_path, "x")
    assert [path.name for path in paths] == ["x_map.png", "x_sheet.png"]
    with Image.open(paths[0]) as picture:
        pixels = np.asarray(picture.convert("RGB")).astype(int)
    coloured = np.ptp(pixels, axis=2) > 60
    height = len(pixels)
    assert coloured[int(0.2 * height) : int(0.7 * height)].mean() > 0.3
    assert coloured[: int(0.15 * height), : pixels.shape[1] // 2].mean() < 0.05, "the upper row diverged"
    none = leave_map([replace_by_diverged(start) for start in starts], material, "elasticity", tmp_path, "y")
    assert [path.name for path in none] == ["y_map.png"]


def replace_by_diverged(start: SceneStart) -> DivergedScene:
    return DivergedScene(start.name, start.parameters, "it left")


def test_cells_end_halfway_between_points_by_difference_or_by_factor() -> None:
    linear = MapAxis("poissons_ratio", np.array([0.1, 0.2, 0.4]), False, (0.1, 0.4))
    np.testing.assert_allclose(cell_edges(linear), [0.05, 0.15, 0.3, 0.5])
    geometric = MapAxis("youngs_modulus", np.array([1e4, 4e4, 1.6e5]), True, (1e4, 1e5))
    np.testing.assert_allclose(cell_edges(geometric), [5e3, 2e4, 8e4, 3.2e5])
    across = map_axis(MATERIALS["sand"], "youngs_modulus")
    np.testing.assert_allclose(across[1:] / across[:-1], (across[-1] / across[0]) ** 0.2, rtol=1e-3)


@pytest.mark.slow
def test_the_command_evaluates_in_one_scene_and_leaves_a_sheet(in_process, tmp_path: Path) -> None:
    arguments = ("material=elasticity", "law=analytic", "task=reconstruction", "floor=false", "output=m.json")
    outcome = in_process(evaluate, "evaluate", *arguments, "task.scene=train-02")
    assert outcome.status == 0, outcome.err
    found = json.loads((tmp_path / "m.json").read_text())
    assert (found["scene"], [scene["name"] for scene in found["scenes"]]) == ("train-02", ["train-02"])
    assert {path.name for path in tmp_path.iterdir()} == {"m.json", "m_sheet.png", "m_error_over_time.png", "m.gif"}
    for name, message in (("train-2", "did you mean 'train-"), ("3", "task.scene='3' is not known")):
        refused = in_process(evaluate, "evaluate", *arguments, f"task.scene={name}", "output=n.json")
        assert (refused.status, len(refused.err.splitlines())) == (2, 1)
        assert message in refused.err
    assert in_process(evaluate, "evaluate", *arguments, "task=unseen", "task.scene=train-02").status == 2


@pytest.mark.slow
def test_the_command_reports_the_floor_of_a_built_in_task(in_process, tmp_path: Path) -> None:
    arguments = ("material=elasticity", "law=analytic", "task=reconstruction", "picture=false", "output=m.json")
    outcome = in_process(evaluate, "evaluate", *arguments, "task.scene=train-02")
    assert outcome.status == 0, outcome.err
    found = json.loads((tmp_path / "m.json").read_text())
    assert set(found["floor"]) == {"float64", "half_step"}
    assert 0.0 < found["floor"]["float64"] < found["floor"]["half_step"] < 1e-3
    assert found["energy_error"] == found["scenes"][0]["energy_error"] == 0.0
    assert "energy_error" in found["units"]
    assert "floor: analytic law in double precision" in outcome.out
