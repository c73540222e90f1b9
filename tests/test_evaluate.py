"""The evaluate command: its result file, its pictures and its refusals."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from recorded_scenes import SAND, moved, recorded, small_cube

from pcnclaws.data.hdf5 import write_scenes
from pcnclaws.evaluate import evaluate
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.simulation.records import SceneRecord


@pytest.fixture(scope="module")
def record() -> SceneRecord:
    return recorded(small_cube("a"), steps=20)[0]


@pytest.fixture
def evaluated(in_process):
    """Runs the command on sand with the analytic law."""

    def run(*arguments: str):
        return in_process(evaluate, "evaluate", "material=sand", "law=analytic", *arguments)

    return run


def test_it_writes_the_errors_of_every_scene_and_leaves_pictures(evaluated, record, tmp_path: Path) -> None:
    write_scenes(tmp_path / "x.h5", [record, replace(moved(record, 0.01), name="b")])
    outcome = evaluated("trajectories=x.h5", "output=new/metrics.json")
    assert outcome.status == 0, outcome.err
    found = json.loads((tmp_path / "new" / "metrics.json").read_text())
    assert [(scene["name"], scene["mse"] == 0.0) for scene in found["scenes"]] == [("a", True), ("b", False)]
    assert found["mse"] == pytest.approx(found["scenes"][1]["mse"] / 2)
    assert {"mse_sum", "rms_percent", "provenance"} < set(found)
    assert (found["law"], found["material"], found["trajectories"]) == ("analytic", "sand", "x.h5")
    names = {path.name for path in (tmp_path / "new").iterdir()}
    assert names == {"metrics.json", "metrics_a.png", "metrics_b.png", "metrics_error_over_time.png", "metrics_a.gif"}
    assert all(f"wrote new/{name}" in outcome.out for name in names)
    assert {path.name for path in tmp_path.iterdir()} == {"x.h5", "new"}


def test_the_precision_is_an_option(evaluated, record, tmp_path: Path) -> None:
    write_scenes(tmp_path / "x.h5", [record])
    assert evaluated("trajectories=x.h5", "output=m.json", "picture=false", "precision=float64").status == 0
    mse = json.loads((tmp_path / "m.json").read_text())["mse"]
    assert 1e-18 < mse < 1e-9, "the rounding of a recording in single precision"
    (fine,) = recorded(small_cube(), dtype=torch.float64)
    write_scenes(tmp_path / "y.h5", [fine])
    assert evaluated("trajectories=y.h5", "output=n.json", "picture=false", "precision=float64").status == 0
    assert json.loads((tmp_path / "n.json").read_text())["mse"] < 1e-28


@pytest.mark.parametrize(
    ("change", "arguments", "status", "message"),
    [
        ({"initial_velocity": None}, [], 2, "no initial_velocity"),
        ({"material": "plasticine"}, [], 2, "material 'plasticine'"),
        ({"parameters": {**SAND, "youngs_modulus": 1e9}}, [], 2, "time_step=0.0005 is unstable"),
        ({}, ["task=unseen"], 2, "trajectories=x.h5"),
        ({}, ["task=unsen"], 2, "did you mean 'unseen'"),
        ({}, ["trajectories=null"], 2, "trajectories=null"),
        ({}, ["trajectories=y.h5"], 2, "y.h5"),
        ({}, ["law=analitic"], 2, "analitic"),
        ({}, ["output=."], 2, "output=."),
    ],
)
def test_wrong_input_is_one_line_exit_2_and_no_result(
    change: dict, arguments: list[str], status: int, message: str, evaluated, record, tmp_path: Path
) -> None:
    write_scenes(tmp_path / "x.h5", [replace(record, keyframes=None, velocity=None, **change)])
    outcome = evaluated("trajectories=x.h5", "output=m.json", *arguments)
    assert outcome.status == status
    assert message in outcome.err
    assert len(outcome.err.splitlines()) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["x.h5"]


def falling_out(record: SceneRecord) -> SceneRecord:
    """Without a wall layer, a body that is fast and low runs through the floor of the domain."""
    low = record.position - np.array([0.0, 0.135, 0.0], dtype=np.float32)
    downwards = np.tile(np.array([0.0, -40.0, 0.0], dtype=np.float32), (64, 1))
    change = {"position": low, "initial_velocity": downwards, "velocity": None, "keyframes": None}
    return replace(record, settings=SimulationSettings(wall_distance=0.0), **change)


def test_a_scene_that_diverges_is_one_line_exit_1_and_no_result(evaluated, record, tmp_path: Path) -> None:
    write_scenes(tmp_path / "x.h5", [falling_out(record)])
    outcome = evaluated("trajectories=x.h5", "output=m.json")
    assert outcome.status == 1
    for word in ("scene 'a'", "step 2", "particle 0", "wall_distance=0 does not hold"):
        assert word in outcome.err
    assert len(outcome.err.splitlines()) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["x.h5"]


def test_scenes_that_may_diverge_are_noted_beside_the_others(evaluated, record, tmp_path: Path) -> None:
    write_scenes(tmp_path / "x.h5", [record, replace(falling_out(record), name="out")])
    outcome = evaluated("trajectories=x.h5", "output=m.json", "may_diverge=true", "picture=false")
    assert outcome.status == 0, outcome.err
    found = json.loads((tmp_path / "m.json").read_text())
    inside, out = found["scenes"]
    assert (inside["mse"], out["mse"], found["mse"]) == (0.0, None, 0.0)
    assert "'out' diverged at step 2" in out["diverged"]
    assert "diverged" in outcome.out
