"""Weights that ship with the package: made from a run folder, small, with a card, and usable as law=pretrained."""

import json
from pathlib import Path

import pytest
import torch

from pcnclaws import runs
from pcnclaws.errors import UserError
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.laws.neural import build_neural_laws
from pcnclaws.runs import METRICS, WEIGHTS, laws_for, start_run
from pcnclaws.ship_weights import LARGEST_BYTES, ship
from pcnclaws.training.weights import law_weights, write_weights

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
    write_weights(folder / WEIGHTS, law_weights(laws), {"ranges": RESULTS["training"]["ranges"]})
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
    shipped, own = (law_weights(laws_for(law, MATERIALS["elasticity"])) for law in ("pretrained", str(run)))
    assert all(torch.equal(shipped[name], own[name]) for name in own)


def test_an_unfinished_run_and_large_weights_do_not_ship(tmp_path: Path) -> None:
    run = finished_run(tmp_path / "run")
    (run / METRICS).unlink()
    with pytest.raises(UserError, match="is missing; accepted: a finished run"):
        ship(run, tmp_path / "pretrained")
    with pytest.raises(UserError, match=f"larger than {LARGEST_BYTES}"):
        ship(finished_run(tmp_path / "wide", 512), tmp_path / "pretrained")
    assert not (tmp_path / "pretrained").exists()


def test_what_ships_fits_its_material_and_is_small() -> None:
    for folder in runs.PRETRAINED.glob("*/"):
        laws_for("pretrained", MATERIALS[folder.name])
        assert (folder / WEIGHTS).stat().st_size < LARGEST_BYTES
        assert (folder / "card.md").is_file()
