"""simulation.time_step=auto of an evaluation: each scene in the longest step that its own stiffness allows."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from recorded_scenes import ELASTIC, moved, recorded, small_cube

from pcnclaws.data.hdf5 import write_scenes
from pcnclaws.evaluate import evaluate
from pcnclaws.evaluation.frames import in_automatic_time_step
from pcnclaws.evaluation.tasks import evaluate_records, steps_to_run
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.simulation.execution import Execution
from pcnclaws.simulation.law_simulator import LawSimulator
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.simulation.scenes import start_of
from pcnclaws.simulation.time_step import COMFORTABLE_CFL, stability_of

SOFT, STIFF = 1e4, 1.5e6


@pytest.fixture(scope="module")
def records() -> list[SceneRecord]:
    """A soft body and a stiff one that land, 5 steps of 5e-4 s between frames."""
    cubes = [
        replace(small_cube(f"E={stiffness:g}", "elasticity"), parameters=ELASTIC | {"youngs_modulus": stiffness})
        for stiffness in (SOFT, STIFF)
    ]
    return recorded(*cubes, steps=60)


def cfl(record: SceneRecord) -> float:
    return stability_of(start_of(record)).cfl


def test_the_step_is_the_longest_that_is_stable_and_meets_the_frames(records: list[SceneRecord]) -> None:
    steps = []
    for record in records:
        own = in_automatic_time_step(record)
        steps.append(own.frame_steps()[1])
        assert np.array_equal(own.frame_steps(), np.arange(13) * steps[-1])
        longer = replace(own, settings=replace(own.settings, time_step=2.5e-3 / max(steps[-1] - 1, 1)))
        assert cfl(own) <= COMFORTABLE_CFL
        assert steps[-1] == 1 or cfl(longer) > 0.99 * COMFORTABLE_CFL
    assert 1 <= steps[0] < 5 < steps[1], "the soft body takes fewer steps than the recording, the stiff one more"


def test_frames_between_the_steps_take_the_longest_step(records: list[SceneRecord]) -> None:
    odd = replace(records[1], time=records[1].time * 1.013, keyframes=None)
    assert 0.98 * COMFORTABLE_CFL < cfl(in_automatic_time_step(odd)) <= COMFORTABLE_CFL


def test_the_motion_is_the_same_but_for_the_error_of_the_step(records: list[SceneRecord]) -> None:
    own = [in_automatic_time_step(record) for record in records]
    assert steps_to_run(own[:1]) < steps_to_run(records[:1])
    analytic = LawSimulator(analytic_laws(MATERIALS["elasticity"]))
    for result in evaluate_records(own, analytic, Execution(torch.float64)):
        assert 1e-14 < result.mse < (2e-3) ** 2, result.name


def test_the_command_takes_it_where_the_step_of_the_file_is_unstable(records, in_process, tmp_path: Path) -> None:
    too_long = replace(records[1].settings, time_step=2.5e-3)
    write_scenes(tmp_path / "x.h5", [replace(moved(records[1], 0.0), settings=too_long, keyframes=None)])
    arguments = ("material=elasticity", "law=analytic", "trajectories=x.h5", "picture=false", "output=m.json")
    refused = in_process(evaluate, "evaluate", *arguments)
    assert refused.status == 2
    assert "time_step=0.0025 is unstable" in refused.err
    assert in_process(evaluate, "evaluate", *arguments, "simulation.time_step=auto").status == 0
    wrong = in_process(evaluate, "evaluate", *arguments, "simulation.time_step=1e-4")
    assert (wrong.status, len(wrong.err.splitlines())) == (2, 1)
    assert "simulation.time_step=0.0001 is not accepted; accepted: auto, or null for the file's own" in wrong.err
