"""Sweeps in processes of their own: each job ends in the table, also a killed one; the same command goes on."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from conftest import Outcome

SMALL = ("law=analytic", "picture=false", "scene.particles_per_edge=4", "scene.side=0.2", "simulation.steps=4")
JOBLIB, SUBMITIT = "hydra_plugins.hydra_joblib_launcher", "hydra_plugins.hydra_submitit_launcher"
LAUNCHERS = pytest.mark.parametrize(
    ("launcher", "plugin"),
    [
        (("hydra/launcher=processes", "hydra.launcher.n_jobs=2"), JOBLIB),
        (("hydra/launcher=slurm_locally",), SUBMITIT),
    ],
    ids=["processes", "slurm_locally"],
)
# A command whose jobs end in the manner that their seeds say.
SCRIPT = """
import os, signal, time
from pathlib import Path
from pcnclaws.commands import launcher
from pcnclaws.errors import SimulationDiverged

def task(config):
    "A task."
    Path(f"began_{config.seed}_{os.getpid()}").touch()
    if config.seed == 2:
        while not list(Path.cwd().glob("ended_1")):  # it would take a job that runs with it
            time.sleep(0.05)
        time.sleep(1.0)
        os.kill(os.getpid(), signal.SIGKILL)
    if config.seed == 3:
        raise SimulationDiverged("it left")
    if config.seed == 60:
        time.sleep(60)
    Path(f"ended_{config.seed}").touch()
    return {"seconds [s]": float(config.seed)}

launcher.main(task, "train")
"""


@pytest.fixture
def started(tmp_path: Path) -> Callable[..., Any]:
    """Starts SCRIPT with these arguments."""
    (tmp_path / "script.py").write_text(SCRIPT)
    modules = os.pathsep.join((str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")))

    def start(*arguments: str) -> "subprocess.Popen[str]":
        return subprocess.Popen(
            [sys.executable, "script.py", *arguments],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": modules},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    return start


def rows(out: str) -> dict[str, str]:
    """The status of each job by what was swept, in a table of one swept option."""
    words = {"done", "failed", "refused"}
    lines = [line.split() for line in out.splitlines()]
    return {line[0]: next(iter(words.intersection(line))) for line in lines if words.intersection(line)}


@pytest.mark.parametrize("name", ["processes", "joblib", "slurm", "submitit_local"])
def test_a_launcher_that_is_not_installed_is_named_with_its_command(name, in_process, monkeypatch):
    for plugin in (JOBLIB, SUBMITIT):
        monkeypatch.setitem(sys.modules, plugin, None)
    outcome = in_process(lambda config: None, "train", "--multirun", f"hydra/launcher={name}", "seed=1,2")
    assert outcome.status == 2
    assert "pip install 'pcnclaws[sweep]'" in outcome.err


def test_a_launcher_without_a_sweep_is_refused(in_process):
    outcome = in_process(lambda config: None, "train", "hydra/launcher=processes")
    assert (outcome.status, outcome.out) == (2, "")
    assert "hydra/launcher=processes has no effect without --multirun" in outcome.err


@pytest.mark.slow
@LAUNCHERS
def test_jobs_run_elsewhere_and_those_that_are_refused_stand_in_the_table(
    launcher: tuple[str, ...], plugin: str, command: Callable[..., Outcome], tmp_path: Path
) -> None:
    pytest.importorskip(plugin)
    done = command("simulate", *SMALL, "--multirun", *launcher, "simulation.every=1,2,9")
    assert done.status == 2
    assert rows(done.out) == {"1": "done", "2": "done", "9": "refused"}
    (line,) = [line for line in done.err.splitlines() if line.startswith("error: ")]
    assert line.startswith("error: job '")
    assert "simulation.every=9 keeps no frame" in line
    found = sorted(path.parent.name for path in (tmp_path / "outputs" / "simulate").rglob("*.h5"))
    assert found == ["simulation.every-1", "simulation.every-2"]


@pytest.mark.slow
@LAUNCHERS
def test_two_jobs_of_a_parallel_sweep_do_not_write_to_one_place(
    launcher: tuple[str, ...], plugin: str, command: Callable[..., Outcome], tmp_path: Path
) -> None:
    pytest.importorskip(plugin)
    options = ("simulation.every=1,2", "scene.affine=zero,velocity", "output=x_${simulation.every}.h5")
    done = command("simulate", *SMALL, "--multirun", *launcher, *options)
    assert done.status == 2
    assert sum("is shared with another job" in line for line in done.err.splitlines()) == 2
    assert {path.name for path in tmp_path.glob("*.h5")} == {"x_1.h5", "x_2.h5"}


@pytest.mark.slow
@LAUNCHERS
def test_a_killed_job_and_a_failed_one_leave_the_table_and_the_status(
    launcher: tuple[str, ...], plugin: str, started: Callable[..., Any]
) -> None:
    pytest.importorskip(plugin)
    with started("--multirun", *launcher, "seed=3,1,2") as process:
        out, said = process.communicate()
    assert process.returncode == 1
    assert rows(out) == {"3": "failed", "1": "done", "2": "failed"}
    assert "job 'seed=3': it left" in said
    assert "job 'seed=2': has not finished" in said
    assert "the same command runs what is missing" in said


@pytest.mark.slow
def test_a_signal_ends_the_jobs_with_the_sweep(started: Callable[..., Any], tmp_path: Path) -> None:
    pytest.importorskip(JOBLIB)
    with started("--multirun", "hydra/launcher=processes", "hydra.launcher.n_jobs=1", "seed=60,61") as process:
        while not (began := list(tmp_path.glob("began_60_*"))):
            time.sleep(0.1)
        process.send_signal(signal.SIGTERM)
        said = process.communicate(timeout=30)
    assert (process.returncode, said[1]) == (143, "error: terminated\n")
    with pytest.raises(ProcessLookupError):
        os.kill(int(began[0].name.rpartition("_")[2]), 0)


@pytest.mark.slow
def test_the_same_sweep_again_trains_nothing_twice(command: Callable[..., Outcome], tmp_path: Path) -> None:
    pytest.importorskip(JOBLIB)
    law = ("material=elasticity", "model.width=4", "training.iterations=2", "training.check_every=1", "threads=1")
    segments = ("training.segment_length={first: 10, last: 10}", "training.batch_segments=1", "picture=false")
    fall = ("scene.centre=[0.5,0.23,0.5]", "scene.velocity=[0,-3,0]", "keyframe_every=10", "output=x.h5")
    simulated = command("simulate", *SMALL[:4], "material=elasticity", "simulation.steps=60", *fall)
    assert simulated.status == 0, simulated.err
    sweep = ("--multirun", "hydra/launcher=processes", "hydra.launcher.n_jobs=2", "data.trajectories=x.h5")
    first = command("train", *law, *segments, *sweep, "seed=0,1")
    assert first.status == 0, first.err
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("weights.safetensors")}
    again = command("train", *law, *segments, *sweep, "seed=0,1,2")
    assert again.status == 0, again.err
    assert again.out.count("holds this run, finished") == len(before) == 2
    assert {path: path.stat().st_mtime_ns for path in before} == before
    assert rows(again.out) == {"0": "done", "1": "done", "2": "done"}
