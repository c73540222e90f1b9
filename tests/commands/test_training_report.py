"""What a training ends with, also where the trained law fails."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
from recorded_scenes import recorded, small_cube
from rich.console import Console

from pcnclaws.commands.training_report import Report, write_report
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.simulation.execution import Execution
from pcnclaws.simulation.law_simulator import LawSimulator
from pcnclaws.training.callbacks import BestWeights, History
from pcnclaws.training.sources import TrainingScenes
from pcnclaws.training.trainer import FitResult


def test_a_test_scene_that_diverges_is_noted_and_the_results_are_kept(tmp_path: Path) -> None:
    record = recorded(small_cube("a"))[0]
    downwards = np.tile(np.array([0.0, -40.0, 0.0], dtype=np.float32), (64, 1))
    low = record.position - np.array([0.0, 0.135, 0.0], dtype=np.float32)
    falls = replace(record, name="out", position=low, initial_velocity=downwards, velocity=None, keyframes=None)
    falls = replace(falls, settings=SimulationSettings(wall_distance=0.0))
    model = LawSimulator(analytic_laws(MATERIALS["sand"]))
    scenes = TrainingScenes([record], [record], [record, falls], MATERIALS["sand"].ranges)
    notes = {"material": "sand", "regime": "multi_scene", "positions_only": False, "iterations": 1}
    fitted = FitResult(History(), BestWeights(model), 0)
    results = {"untrained": model, "trained": model, "started": 0.0, "execution": Execution()}
    report = Report(tmp_path, scenes, fitted, notes, **results)
    console = Console(width=120)
    with console.capture() as said:
        write_report(report, 0, pictures=True, console=console)
    found = json.loads((tmp_path / "metrics.json").read_text())
    inside, out = found["scenes"]
    assert (inside["mse"], out["mse"], found["mse"]) == (0.0, None, 0.0)
    assert "'out' diverged at step 2" in out["diverged"]
    assert found["guards"]["scenes_that_diverged"] >= 1
    assert "diverged" in said.get()
    assert (tmp_path / "predicted_a.png").exists()
