"""Guards count what a run survives or ends with, and the JSON files of commands hold the counts."""

import json
from pathlib import Path

import pytest
import torch

import pcnclaws as pc
from pcnclaws import guards
from pcnclaws.compiled.build import find_compiler
from pcnclaws.evaluate import evaluate

needs_kernels = pytest.mark.skipif(find_compiler() is None, reason="needs a C++ compiler")
BODY = pc.Body.cube(side=0.2, centre=(0.5, 0.3, 0.5), particles_per_edge=4)


@pytest.fixture(autouse=True)
def begun() -> None:
    guards.restart()


def test_an_ordinary_run_counts_nothing() -> None:
    pc.Scene(BODY, pc.load_law("sand")).simulate(20, 10)
    assert set(guards.counts()) == set(guards.WORDS)
    assert not any(guards.counts().values())
    assert guards.in_words() == ""


def test_what_leaves_the_training_data_and_what_diverges_is_counted() -> None:
    law = pc.load_law("elasticity")
    pc.Scene(BODY, law, youngs_modulus=3.2e5, poissons_ratio=0.42).simulate(10, 5)
    assert guards.counts()["parameters_outside_training_data"] == 2
    with pytest.raises(pc.SimulationDiverged):
        pc.Scene(BODY, pc.analytic_law("elasticity"), velocity=(0, -40.0, 0)).simulate(500, 5)
    assert guards.counts()["scenes_that_diverged"] == 1
    assert guards.counts()["particles_that_failed"] >= 1


@needs_kernels
def test_the_slow_path_and_laws_in_pytorch_are_counted_and_said() -> None:
    law = pc.analytic_law("sand")
    law.stress(torch.diag_embed(torch.tensor([[1e-4, 1.0, 1.0]])), youngs_modulus=1e5, poissons_ratio=0.2)
    assert guards.counts()["principal_axes_by_the_slow_path"] == 1
    with pc.using_backend("torch"):  # asked for, and therefore no news
        law.stress(torch.eye(3)[None], youngs_modulus=1e5, poissons_ratio=0.2)
    assert guards.counts()["law_evaluations_in_pytorch"] == 0
    mixed = {"youngs_modulus": torch.tensor([1e5], dtype=torch.float64), "poissons_ratio": torch.tensor([0.2])}
    law.laws.elasticity(torch.eye(3)[:, :, None], mixed)
    assert guards.counts()["law_evaluations_in_pytorch"] == 1
    assert guards.in_words().startswith("1 particles far from det F = 1")


def test_the_metrics_of_an_evaluation_hold_the_counts(in_process, tmp_path: Path) -> None:
    made = pc.Scene(BODY, pc.analytic_law("sand"), friction_angle=60.0).simulate(20, 5)
    made.save(tmp_path / "x.h5")
    done = in_process(
        evaluate, "evaluate", "material=sand", "trajectories=x.h5", "output=metrics.json", "picture=false"
    )
    assert done.status == 0, done.err
    assert json.loads((tmp_path / "metrics.json").read_text())["guards"]["parameters_outside_training_data"] == 1
