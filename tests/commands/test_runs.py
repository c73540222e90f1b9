"""Run folders: read back as laws, and never taken for what they are not."""

import json
import logging
from pathlib import Path
from typing import Any

import pytest
import torch
import yaml
from safetensors.torch import save_file

from pcnclaws.commands.runs import CONFIG, METRICS, WEIGHTS, is_finished, laws_for, load_run, start_run
from pcnclaws.errors import UserError
from pcnclaws.laws.elasticity import FixedCorotated
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.laws.neural import build_neural_laws
from pcnclaws.simulation.law_simulator import LawSimulator
from pcnclaws.training.weights import model_weights, read_weights, write_weights

MODEL = {"name": "pcnclaws", "width": 8}
CONFIGURATION: dict[str, Any] = {
    "material": {"name": "elasticity"},
    "model": MODEL,
    "training": {"iterations": 3},
    "device": "cpu",
    "output": "here",
}
RANGES = {"youngs_modulus": [1e5, 2e5], "poissons_ratio": [0.1, 0.3]}


def neural_model(seed: int = 0) -> LawSimulator:
    torch.manual_seed(seed)
    return LawSimulator(build_neural_laws(MATERIALS["elasticity"], MODEL))


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A finished run folder."""
    folder = tmp_path / "run"
    start_run(folder, CONFIGURATION)
    write_weights(folder / WEIGHTS, model_weights(neural_model(1)), {"ranges": RANGES})
    (folder / METRICS).write_text("{}")
    return folder


def test_a_run_folder_gives_back_its_laws(run: Path) -> None:
    moved = run.rename(run.with_name("moved"))
    loaded = load_run(moved)
    assert loaded.material.name == "elasticity"
    assert loaded.config == CONFIGURATION
    expected = model_weights(neural_model(1))
    assert expected.keys() == model_weights(loaded.model).keys()
    assert all(torch.equal(weight, expected[name]) for name, weight in model_weights(loaded.model).items())


def test_a_run_folder_of_before_the_groups_of_options_loads_and_is_not_continued(run: Path) -> None:
    """Its options had other names; those that a law is built from have stayed."""
    old = {name: CONFIGURATION[name] for name in ("material", "model")} | {"train": {"iterations": 3, "precision": 32}}
    (run / CONFIG).write_text(yaml.safe_dump(old))
    expected = model_weights(neural_model(1))
    assert all(torch.equal(weight, expected[name]) for name, weight in model_weights(load_run(run).model).items())
    groups = {"trainer": {"devices": None}, "callbacks": {"early_stopping": {"patience": None}}}
    with pytest.raises(UserError, match="holds a run of another configuration .*accepted: .*overwrite=true") as refused:
        is_finished(run, CONFIGURATION | groups)
    assert "\n" not in str(refused.value)


def test_law_names() -> None:
    assert isinstance(laws_for("analytic", MATERIALS["elasticity"]).elasticity, FixedCorotated)
    with pytest.raises(UserError, match=r"law=pretrained: no weights ship for tresca.*material=tresca"):
        laws_for("pretrained", MATERIALS["tresca"])
    with pytest.raises(UserError, match=r"law=nowhere is not a folder; accepted: analytic, pretrained, or the path"):
        laws_for("nowhere", MATERIALS["sand"])


def test_a_run_of_another_material_is_refused(run: Path) -> None:
    with pytest.raises(UserError, match="was trained for material=elasticity, not sand"):
        laws_for(str(run), MATERIALS["sand"])


def test_parameters_outside_the_training_data_are_said_in_one_line(run: Path, caplog: pytest.LogCaptureFixture) -> None:
    inside = {"youngs_modulus": 1.5e5, "poissons_ratio": 0.3}
    with caplog.at_level(logging.WARNING):
        laws_for(str(run), MATERIALS["elasticity"], [inside])
        assert not caplog.records
        laws_for(str(run), MATERIALS["elasticity"], [inside, {"youngs_modulus": 5e5, "poissons_ratio": 0.2}])
    assert len(caplog.records) == 1
    assert caplog.messages[0].endswith(
        "used outside its training data: youngs_modulus=500000 (trained on 100000 to 200000 Pa)"
    )


def test_weights_that_do_not_fit_the_configuration_are_refused(run: Path) -> None:
    wider = CONFIGURATION | {"model": MODEL | {"width": 16}}
    (run / CONFIG).write_text(yaml.safe_dump(wider))
    with pytest.raises(UserError, match="the weights do not fit the configuration: 'elasticity.*has shape"):
        load_run(run)
    weights = model_weights(neural_model())
    name, _ = weights.popitem()
    write_weights(run / WEIGHTS, weights, {})
    (run / CONFIG).write_text(yaml.safe_dump(CONFIGURATION))
    with pytest.raises(UserError, match=f"'{name}' is missing"):
        load_run(run)
    write_weights(run / WEIGHTS, model_weights(neural_model()) | {"other": torch.zeros(2)}, {})
    with pytest.raises(UserError, match="'other' is not part of the law"):
        load_run(run)
    write_weights(run / WEIGHTS, {key: weight / 0.0 for key, weight in model_weights(neural_model()).items()}, {})
    with pytest.raises(UserError, match="not finite"):
        load_run(run)


def test_damaged_and_foreign_weights_are_refused(run: Path) -> None:
    whole = (run / WEIGHTS).read_bytes()
    for content in (b"", whole[: len(whole) // 2], b"\x80\x04pickle" * 100):
        (run / WEIGHTS).write_bytes(content)
        with pytest.raises(UserError, match="is damaged or was not written by pcnclaws"):
            read_weights(run / WEIGHTS)
    save_file({"a": torch.zeros(2)}, run / WEIGHTS)
    with pytest.raises(UserError, match="was not written by pcnclaws"):
        read_weights(run / WEIGHTS)
    (run / WEIGHTS).unlink()
    with pytest.raises(UserError, match="is missing; the training run is not finished"):
        load_run(run)


@pytest.mark.parametrize(
    "text",
    [
        "material: !!python/object/apply:os.system ['true']",
        "[1, 2]",
        "material: {name: elasticity}",
        "a: [",
        "\x00",
    ],
)
def test_a_configuration_that_is_not_one_of_ours_is_refused(run: Path, text: str) -> None:
    (run / CONFIG).write_text(text)
    with pytest.raises(UserError, match=CONFIG):
        load_run(run)


def test_a_configuration_never_chooses_a_class(run: Path) -> None:
    (run / CONFIG).write_text(yaml.safe_dump(CONFIGURATION | {"model": {"_target_": "os.system", "name": "echo"}}))
    with pytest.raises(UserError):
        load_run(run)
    (run / CONFIG).write_text(yaml.safe_dump(CONFIGURATION | {"material": {"name": "elasticty"}}))
    with pytest.raises(UserError, match="did you mean 'elasticity'"):
        load_run(run)


def test_a_run_folder_belongs_to_one_configuration(run: Path) -> None:
    assert is_finished(run, CONFIGURATION)
    assert is_finished(run, CONFIGURATION | {"device": "cuda", "output": "elsewhere"}), "where a run is does not matter"
    with pytest.raises(UserError, match=r"training.iterations: 3 there, 2 asked for.*overwrite=true"):
        is_finished(run, CONFIGURATION | {"training": {"iterations": 2}})
    assert not is_finished(run, CONFIGURATION | {"training": {"iterations": 4}}), "it goes on"
    (run / METRICS).unlink()
    assert not is_finished(run, CONFIGURATION)


def test_a_folder_with_something_else_in_it_is_left_alone(tmp_path: Path) -> None:
    assert not is_finished(tmp_path / "new", CONFIGURATION)
    assert not is_finished(tmp_path, CONFIGURATION)
    precious = tmp_path / "thesis.txt"
    precious.write_text("precious")
    with pytest.raises(UserError, match="is not empty and holds no run"):
        is_finished(tmp_path, CONFIGURATION)
    with pytest.raises(UserError, match="is a file"):
        is_finished(precious, CONFIGURATION)


def test_overwriting_removes_what_the_other_run_left(run: Path) -> None:
    (run / "notes.txt").write_text("mine")
    (run / "checkpoints").mkdir()
    start_run(run, CONFIGURATION, overwrite=True)
    assert sorted(entry.name for entry in run.iterdir()) == [CONFIG, "notes.txt"]


def test_the_notes_of_weights_are_text(run: Path) -> None:
    weights, notes = read_weights(run / WEIGHTS)
    assert notes == json.loads(json.dumps({"ranges": RANGES}))
    assert all(isinstance(weight, torch.Tensor) for weight in weights.values())
