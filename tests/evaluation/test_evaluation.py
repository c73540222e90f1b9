"""Evaluating laws on recorded scenes: what is compared with what."""

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from recorded_scenes import SAND, moved, recorded, small_cube, softer_sand
from rich.console import Console

from pcnclaws.errors import SimulationDiverged, UserError
from pcnclaws.evaluation import gallery
from pcnclaws.evaluation.builtin import builtin_task, paper_errors
from pcnclaws.evaluation.gallery import leave_pictures, leave_sheet
from pcnclaws.evaluation.report import metrics, results_table, write_metrics
from pcnclaws.evaluation.tasks import evaluate_records, steps_to_run
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.provenance import provenance
from pcnclaws.rendering.comparison_sheet import Pair
from pcnclaws.simulation.execution import SINGLE_ON_CPU, Execution
from pcnclaws.simulation.law_simulator import LawSimulator
from pcnclaws.simulation.motion import SceneSimulator
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.simulation.scenes import SceneStart

ANALYTIC = LawSimulator(analytic_laws(MATERIALS["sand"]))


@pytest.fixture(scope="module")
def records() -> list[SceneRecord]:
    return recorded(small_cube("a"), small_cube("b", velocity=(0.0, -1.0, 1.0)))


def frames(record: SceneRecord, indices: list[int]) -> SceneRecord:
    return replace(record, time=record.time[indices], position=record.position[indices], velocity=None, keyframes=None)


def test_the_law_that_made_a_scene_has_no_error(records: list[SceneRecord]) -> None:
    for record, result in zip(records, evaluate_records(records, ANALYTIC), strict=True):
        assert (result.name, result.mse, result.stress_error) == (record.name, 0.0, 0.0)
        np.testing.assert_array_equal(result.predicted.position, record.position)


class Still(SceneSimulator):
    """A simulator of one's own: nothing ever moves."""

    def simulate(
        self, starts: Sequence[SceneStart], plan: FramePlan, execution: Execution = SINGLE_ON_CPU
    ) -> list[SceneRecord]:
        records = ANALYTIC.simulate(starts, plan._replace(keyframe_every=0), execution)
        return [replace(record, position=np.repeat(record.position[:1], len(record.time), 0)) for record in records]


def test_whatever_simulates_is_evaluated_by_its_positions(records: list[SceneRecord]) -> None:
    for record, result in zip(records, evaluate_records(records, Still()), strict=True):
        expected = np.square(record.position.astype(float) - record.position[0]).mean()
        assert result.mse == pytest.approx(expected, rel=1e-5)
        assert result.stress_error is None
        assert result.energy_error is None


def test_errors_are_those_of_the_metrics(records: list[SceneRecord]) -> None:
    result = evaluate_records([moved(records[0], 0.01)], ANALYTIC)[0]
    assert result.mse == pytest.approx(1e-4 / 3 * 6 / 7, rel=1e-4)
    assert result.mse_sum == pytest.approx(3 * result.mse)
    assert result.rms_percent == pytest.approx(100 * math.sqrt(result.mse_sum) / 0.2, rel=1e-5)
    np.testing.assert_allclose(result.mse_by_frame, [0.0] + [1e-4 / 3] * 6, rtol=1e-3)


def test_sparse_and_late_frames_are_compared_at_their_own_times(records: list[SceneRecord]) -> None:
    sparse = frames(records[0], [0, 1, 4, 6])
    later = replace(sparse, time=sparse.time + 7.0)
    for record in (sparse, later):
        result = evaluate_records([record], ANALYTIC)[0]
        assert result.mse == 0.0
        np.testing.assert_allclose(result.time, [0.0, 0.0025, 0.01, 0.015])


def test_frames_between_steps_are_compared_with_the_line_between_the_steps() -> None:
    falling = small_cube(velocity=(1.0, 0.0, 0.0), settings=SimulationSettings(gravity=(0.0, 0.0, 0.0)))
    record = recorded(falling, steps=8, every=1)[0]
    time = np.array([0.0, 3.5, 7.25]) * record.settings.time_step
    position = falling.position + time[:, None, None] * np.array([1.0, 0.0, 0.0])
    between = replace(record, time=time, position=position.astype(np.float32), velocity=None, keyframes=None)
    assert evaluate_records([between], ANALYTIC)[0].mse < 1e-13


def test_scenes_of_different_lengths_and_settings_are_evaluated_together(records: list[SceneRecord]) -> None:
    fine = small_cube("fine", settings=SimulationSettings(grid_spacing=1 / 32))
    finer = recorded(fine, steps=12, every=3, keyframe_every=0)[0]
    mixed = [finer, frames(records[1], [0, 2, 5]), records[0]]
    done: list[int] = []
    results = evaluate_records(mixed, ANALYTIC, Execution(progress=done.append))
    assert [result.name for result in results] == ["fine", "b", "a"]
    assert [result.mse for result in results] == pytest.approx([0.0, 0.0, 0.0], abs=1e-14)
    assert sum(done) == steps_to_run(mixed)


def test_unobserved_particles_do_not_count(records: list[SceneRecord]) -> None:
    position = moved(records[0], 0.01).position
    position[2:, ::2] = np.nan
    assert evaluate_records([replace(records[0], position=position)], ANALYTIC)[0].mse == pytest.approx(
        1e-4 / 3 * 6 / 7, rel=1e-3
    )


def test_the_stress_error_is_that_of_the_law_and_needs_states_after_contact(records: list[SceneRecord]) -> None:
    assert evaluate_records(records, softer_sand())[0].stress_error == pytest.approx(0.1, rel=1e-4)
    assert evaluate_records([frames(records[0], [0, 1])], softer_sand())[0].stress_error is None
    high = small_cube()
    high = replace(high, position=high.position + np.array([0.0, 0.25, 0.0]))
    assert evaluate_records(recorded(high, steps=10), softer_sand())[0].stress_error is None


def test_parameters_of_other_materials_in_the_file_do_not_matter(records: list[SceneRecord]) -> None:
    more = replace(records[0], parameters={**records[0].parameters, "yield_stress": 1e3})
    assert [result.mse for result in evaluate_records([more, records[1]], ANALYTIC)] == [0.0, 0.0]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"initial_velocity": None}, "no initial_velocity"),
        ({"parameters": {"youngs_modulus": 1e5, "poissons_ratio": 0.2}}, "friction_angle is missing"),
        ({"material": "water"}, "'water' is not known"),
        ({"time": np.zeros(1), "position": np.full((1, 64, 3), 0.5, np.float32), "velocity": None}, "nothing to comp"),
    ],
)
def test_records_that_cannot_be_evaluated_are_refused_by_name(
    records: list[SceneRecord], change: dict, message: str
) -> None:
    with pytest.raises(UserError, match=message) as error:
        evaluate_records([replace(records[0], **change)], ANALYTIC)
    assert "scene 'a'" in str(error.value)


def test_a_diverged_scene_is_named(records: list[SceneRecord]) -> None:
    stiff = replace(records[0], parameters={**SAND, "youngs_modulus": 1e9})
    with pytest.raises(SimulationDiverged, match="a"):
        evaluate_records([stiff], ANALYTIC)


def test_metrics_are_means_over_scenes_and_survive_the_way_through_json(
    records: list[SceneRecord], tmp_path: Path
) -> None:
    results = evaluate_records([moved(records[0], 0.01), frames(records[1], [0, 3])], ANALYTIC)
    written = write_metrics(tmp_path / "deep" / "m.json", metrics(results) | {"bad": math.inf, "p": provenance(3)})
    read = json.loads(written.read_text())
    assert read["mse"] == pytest.approx((results[0].mse + results[1].mse) / 2)
    assert read["mse_sum"] == pytest.approx(3 * read["mse"])
    assert [scene["name"] for scene in read["scenes"]] == ["a", "b"]
    assert read["scenes"][0]["mse"] == results[0].mse
    for curve in ("time", "mse_by_frame"):
        values = read["scenes"][0][curve]
        assert values == pytest.approx(getattr(results[0], curve).tolist(), rel=6e-4)
        assert max(len(f"{value:.12g}".partition("e")[0].strip("0.")) for value in values) <= 5
    assert "time" not in metrics(results, curves=False)["scenes"][0]
    assert read["scenes"][1]["stress_error"] is None
    assert read["bad"] is None
    assert read["p"]["seed"] == 3
    assert read["p"]["command"].startswith("python ")


def test_the_table_sets_before_and_paper_beside_the_error(records: list[SceneRecord]) -> None:
    results = evaluate_records(records, ANALYTIC)
    console = Console(width=100, file=StringIO())
    with console.capture() as capture:
        console.print(results_table(results, "sand", evaluate_records(records, softer_sand()), {"a": 2e-4}))
    text = capture.get()
    for word in ("before", "paper", "2.0e-04", "0.0e+00", "[kPa]", "mean"):
        assert word in text


def test_the_gallery_keeps_strange_scene_names_out_of_file_names(records: list[SceneRecord], tmp_path: Path) -> None:
    result = evaluate_records([frames(replace(records[0], name="wet/../sand 1"), [0, 1])], ANALYTIC)
    names = [path.name for path in leave_pictures(result, tmp_path, "x", before=result)]
    assert names == ["x_wet_.._sand_1.png", "x_error_over_time.png", "x_wet_.._sand_1.gif"]
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names)


def test_a_sheet_of_many_scenes_holds_the_worst_ones(
    records: list[SceneRecord], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[list[str]] = []

    def note(pairs: list[Pair], path: Path, title: str) -> Path:
        shown.append([pair.true.name for pair in pairs])
        assert "of 8 scenes the 6 with the largest errors" in title
        return path

    monkeypatch.setattr(gallery, "comparison_sheet", note)
    (result,) = evaluate_records(records[:1], softer_sand())
    mse = [3e-6, 1e-6, 9e-6, 4e-6, 2e-6, 7e-6, 8e-6, 5e-6]
    results = [replace(result, true=replace(result.true, name=str(k)), mse=value) for k, value in enumerate(mse)]
    paths = leave_sheet(results, "sand", tmp_path, "x")
    assert shown == [["0", "2", "3", "5", "6", "7"]]
    assert [path.name for path in paths] == ["x_sheet.png", "x_error_over_time.png", "x.gif"]


def test_unseen_are_the_papers_objects_and_reconstruction_the_training_scenes() -> None:
    sand = MATERIALS["sand"]
    unseen = {start.name: dict(start.parameters) for start in builtin_task("unseen", sand).starts}
    assert set(paper_errors(sand)) < set(unseen)
    assert {"youngs_modulus": 3.7e5, "poissons_ratio": 0.18, "friction_angle": 30.0} in unseen.values()
    assert len(builtin_task("reconstruction", sand).starts) >= 12
    with pytest.raises(UserError, match="did you mean 'unseen'"):
        builtin_task("unsen", sand)
