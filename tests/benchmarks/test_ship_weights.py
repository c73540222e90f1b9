"""Weights that ship with the package: made from a run folder, small, with a card, and usable as law=pretrained."""

import json
from pathlib import Path
from statistics import mean

import pytest
import torch

from benchmarks.ship_weights import LARGEST_BYTES, ship
from pcnclaws.commands import runs
from pcnclaws.commands.runs import METRICS, WEIGHTS, model_for, start_run
from pcnclaws.errors import UserError
from pcnclaws.evaluation.builtin import builtin_task, true_records
from pcnclaws.evaluation.tasks import evaluate_records
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.laws.neural import build_neural_laws
from pcnclaws.simulation.law_simulator import LawSimulator
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.training.weights import model_weights, write_weights

RESULTS = {
    "training": {"training_scenes": 12, "positions_only": False, "iterations": 200, "best_iteration": 160,
                 "validation_mse": 1e-7, "ranges": {"youngs_modulus": [1e5, 2e5], "poissons_ratio": [0.1, 0.4]}},
    "provenance": {"command": "python -m pcnclaws.train experiment=elasticity_multi", "seed": 0,
                   "processor": "a processor", "threads": 1, "precision": "float32", "torch": "2.13.0",
                   "commit": "0123456789abcdef"},
    "seconds": 90.0,
    "scenes": [{"name": "test-1", "mse": 2.5e-8, "rms_percent": 0.05, "stress_error": 0.003}],
}  # fmt: skip


def finished_run(folder: Path, width: int = 64) -> Path:
    model = {"name": "pcnclaws", "width": width}
    laws = build_neural_laws(MATERIALS["elasticity"], model)
    for law in laws:
        if law is not None:
            torch.nn.init.uniform_(next(law.parameters()))
    start_run(
        folder,
        {
            "material": {"name": "elasticity"},
            "model": model,
            "output": "somewhere",
            "data": {"seed": 0, "validation_scenes": 2},
        },
    )
    write_weights(folder / WEIGHTS, model_weights(LawSimulator(laws)), {"ranges": RESULTS["training"]["ranges"]})
    (folder / METRICS).write_text(json.dumps(RESULTS))
    return folder


def test_shipped_weights_are_those_of_the_run_with_a_card_and_nothing_of_its_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = finished_run(tmp_path / "run")
    folder = ship(run, tmp_path / "pretrained")
    assert folder == tmp_path / "pretrained" / "elasticity"
    text = (folder / "card.md").read_text()
    for expected in ("experiment=elasticity_multi", "12 training scenes", "1.5 min", "100000 to 200000 Pa", "2.5e-08"):
        assert expected in text
    assert "somewhere" not in (folder / "config.yaml").read_text()
    monkeypatch.setattr(runs, "PRETRAINED", tmp_path / "pretrained")
    shipped, own = (model_weights(model_for(law, MATERIALS["elasticity"])) for law in ("pretrained", str(run)))
    assert all(torch.equal(shipped[name], own[name]) for name in own)


def test_an_unfinished_run_and_large_weights_do_not_ship(tmp_path: Path) -> None:
    run = finished_run(tmp_path / "run")
    (run / METRICS).unlink()
    with pytest.raises(UserError, match="is missing; accepted: a finished run"):
        ship(run, tmp_path / "pretrained")
    with pytest.raises(UserError, match=f"larger than {LARGEST_BYTES}"):
        ship(finished_run(tmp_path / "wide", 512), tmp_path / "pretrained")
    assert not (tmp_path / "pretrained").exists()


@pytest.mark.parametrize(("material", "largest_mse"), [("elasticity", 1e-11), ("plasticine", 1e-6), ("sand", 1e-6)])
@pytest.mark.slow
def test_what_ships_is_small_and_right_on_objects_that_it_never_saw(material: str, largest_mse: float) -> None:
    folder = runs.PRETRAINED / material
    assert (folder / WEIGHTS).stat().st_size < LARGEST_BYTES
    assert "Errors on objects that it was not trained on" in (folder / "card.md").read_text(encoding="utf-8")
    model = model_for("pretrained", MATERIALS[material])
    records = [record for record in true_records(builtin_task("unseen", MATERIALS[material]), MATERIALS[material])
               if isinstance(record, SceneRecord)]  # fmt: skip
    results = evaluate_records(records, model)
    assert len(results) == 3
    assert mean([result.mse for result in results]) < largest_mse
    assert all((result.stress_error or 1.0) < 0.02 for result in results)
