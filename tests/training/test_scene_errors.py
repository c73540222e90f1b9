"""Scenes that contradict the others: they are named, and the robust loss learns from the others."""

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from conftest import Outcome
from training_bodies import recorded

from pcnclaws.commands.runs import METRICS
from pcnclaws.data.hdf5 import write_scenes
from pcnclaws.train import train
from pcnclaws.training.scene_errors import CONTRADICTS, HALF, SceneErrors


def noted(errors: dict[str, float], rounds: int = 40) -> SceneErrors:
    scenes = SceneErrors()
    for _ in range(rounds):
        scenes.note(list(errors), list(errors.values()))
    return scenes


def test_a_scene_is_compared_with_the_median_of_all() -> None:
    errors = {"a": 1e-6, "b": 2e-6, "c": 2e-6, "d": 4e-6, "odd": 2e-3}
    scenes = noted(errors)
    assert scenes.ratio("odd") == pytest.approx(1e3)
    assert scenes.contradicting() == {"odd": pytest.approx(1e3)}
    assert scenes.weights(["b", "odd"]) == pytest.approx([1 / (1 + HALF**-2), 1 / (1 + (1e3 / HALF) ** 2)])
    assert CONTRADICTS > HALF
    again = SceneErrors()
    again.load_state_dict(json.loads(json.dumps(scenes.state_dict())))
    assert again.contradicting() == scenes.contradicting()


def test_what_says_nothing_changes_nothing() -> None:
    scenes = noted({"a": 1e-6, "b": 1e-6, "c": 1e-6})
    assert [scenes.ratio(name) for name in ("a", "unknown")] == [1.0, 1.0], "too few scenes to tell one from the others"
    scenes = noted({"a": 1e-6, "b": 1e-6, "c": 1e-6, "d": 1e-6})
    scenes.note(["a", "b"], [math.inf, 0.0])
    assert scenes.contradicting() == {}
    assert scenes.ratio("a") == pytest.approx(1.0)


def test_old_errors_are_forgotten() -> None:
    scenes = noted({"a": 1e-3, "b": 1e-3, "c": 1e-3, "d": 1e-6})
    for _ in range(200):
        scenes.note(["a", "b", "c"], [1e-6] * 3)
    assert scenes.ratio("d") == pytest.approx(1.0, rel=1e-3)


@pytest.mark.slow
def test_a_false_scene_is_named_and_not_obeyed(in_process: Callable[..., Outcome], tmp_path: Path) -> None:
    """One body of six says that it is three times as stiff as it is."""
    records = recorded(6)
    false = dict(records[2].parameters) | {"youngs_modulus": 3.0 * records[2].parameters["youngs_modulus"]}
    write_scenes(tmp_path / "true.h5", records)
    write_scenes(
        tmp_path / "false.h5", [replace(one, parameters=false) if one is records[2] else one for one in records]
    )
    options = (
        "material=elasticity",
        "training.iterations=200",
        "training.check_every=50",
        "picture=false",
        "threads=1",
    )
    errors, named = {}, {}
    for file, loss in (("true", "relative"), ("false", "relative"), ("false", "robust")):
        run = f"{file}_{loss}"
        given = (*options, f"data.trajectories={file}.h5", f"training.loss={loss}", f"output={run}")
        done = in_process(train, "train", *given)
        assert done.status == 0, done.err
        metrics = json.loads((tmp_path / run / METRICS).read_text())
        errors[run], named[run] = metrics["mse"], metrics["training"]["contradicting_scenes"]
    assert named["true_relative"] == {}
    assert list(named["false_robust"]) == ["body_2"]
    assert "warning: scene 'body_2' is explained" in done.out
    assert errors["false_robust"] < 3.0 * errors["true_relative"]
    assert errors["false_relative"] > 10.0 * errors["false_robust"]
