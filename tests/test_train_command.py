"""python -m pcnclaws.train on a user's own file, killed and continued, and refused where the input is wrong."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from conftest import Outcome
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from training_bodies import EVERY, Scaled, lifted, recorded, starts

from pcnclaws.commands.models import build_model
from pcnclaws.commands.runs import CONFIG, METRICS, WEIGHTS, load_run, read_config
from pcnclaws.data.hdf5 import write_scenes
from pcnclaws.laws.analytic import Laws
from pcnclaws.laws.elasticity import NeoHookean, StVKHencky
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.train import train
from pcnclaws.training.checkpoints import LAST, PREVIOUS, newest_checkpoint
from pcnclaws.training.weights import model_weights, read_weights

SMALL = ("material=elasticity", "model.width=8", "training.batch_segments=2", "threads=1", "picture=false")
SHORT = (
    "training.iterations=2",
    "training.check_every=1",
    "training.segment_length.first=10",
    "training.segment_length.last=10",
)
CLIP = ("trainer.gradient_clip_algorithm=norm",)
LONGER = (
    "training.iterations=8",
    "training.check_every=2",
    "training.segment_length.first=10",
    "training.segment_length.last=20",
)


@pytest.fixture(scope="module")
def positions_only(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four neo-Hookean bodies: their law is neither ours nor of our networks. Positions and initial velocities only."""
    path = tmp_path_factory.mktemp("own") / "bodies.h5"
    bodies = recorded(4, NeoHookean(), keyframes=False)
    write_scenes(path, [replace(body, velocity=None, material="rubber") for body in bodies])
    return path


def test_a_users_own_file_trains_on_positions_only(
    in_process: Callable[..., Outcome], positions_only: Path, tmp_path: Path
) -> None:
    options = (
        *SMALL,
        f"data.trajectories={positions_only}",
        "output=run",
        "training.iterations=24",
        "training.check_every=10",
        "training.learning_rate=0.002",
        "training.segment_length.first=20",
        "training.segment_length.last=20",
    )
    done = in_process(train, "train", *options)
    assert done.status == 0, done.err
    assert "3 scenes to train on, 1 for the checks: body_3" in done.out
    assert "checks every 12 iterations, which divides training.iterations=24" in done.out
    assert "trains on positions only, since no scene has keyframes after its start: training.start=initial" in done.out
    assert "segments of 20 steps start from the initial state" in done.out
    assert "training made nothing better" not in done.out
    metrics = json.loads((tmp_path / "run" / METRICS).read_text())
    assert metrics["training"]["positions_only"] is True
    assert metrics["training"]["better_than_untrained"] is True
    assert metrics["training"]["validation_mse_before_training"] == pytest.approx(metrics["mse_before_training"])
    assert metrics["mse"] < metrics["mse_before_training"]
    assert len(metrics["history"]["loss"]) == 24
    assert [scene["name"] for scene in metrics["scenes"]] == ["body_3"]
    assert load_run(tmp_path / "run").ranges["youngs_modulus"] == pytest.approx((2e4, 3.2e4))

    for stated in ((), ("training.start=initial", "training.check_every=10", "training.average=null")):
        again = in_process(train, "train", *options, *stated)
        assert (again.status, again.err) == (0, "")
        assert "run holds this run, finished" in again.out
    other = in_process(train, "train", *options, "seed=5")
    assert other.status == 2
    assert "output=run holds a run of another configuration (seed: 0 there, 5 asked for)" in other.err


@pytest.mark.slow
def test_the_same_command_continues_a_killed_run_bit_for_bit(
    in_process: Callable[..., Outcome], positions_only: Path, tmp_path: Path
) -> None:
    options = (*SMALL, *LONGER, f"data.trajectories={positions_only}")
    checkpoints = tmp_path / "killed" / "checkpoints"
    _kill_once(
        lambda: all((checkpoints / name).exists() for name in (LAST, PREVIOUS)), tmp_path, *options, "output=killed"
    )
    assert read_weights(tmp_path / "killed" / WEIGHTS)[1]["unfinished"], "the best so far may be used"
    shutil.copytree(tmp_path / "killed", tmp_path / "damaged")
    last = tmp_path / "damaged" / "checkpoints" / LAST
    last.write_bytes(last.read_bytes()[:5000])

    for output in ("killed", "damaged", "whole"):
        done = in_process(train, "train", *options, f"output={output}")
        assert done.status == 0, done.err
    weights, notes = read_weights(tmp_path / "whole" / WEIGHTS)
    for output in ("killed", "damaged"):
        continued, continued_notes = read_weights(tmp_path / output / WEIGHTS)
        assert all(torch.equal(weight, continued[name]) for name, weight in weights.items()), output
        assert continued_notes == notes
        histories = [json.loads((tmp_path / name / METRICS).read_text())["history"] for name in ("whole", output)]
        assert histories[0] == histories[1]


def test_a_finished_run_goes_on_for_more_iterations(
    in_process: Callable[..., Outcome], positions_only: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    options = (*SMALL, f"data.trajectories={positions_only}", "output=run", "training.check_every=2")
    options += ("training.segment_length.first=10", "training.segment_length.last=10")
    short, long, odd = (f"training.iterations={count}" for count in (4, 8, 11))
    assert in_process(train, "train", *options, short).status == 0
    first = json.loads((tmp_path / "run" / METRICS).read_text())["history"]
    refused = in_process(train, "train", *options, odd)
    assert refused.status == 2
    assert "the run has checks every 2 iterations; accepted: a multiple of 2" in refused.err
    assert json.loads((tmp_path / "run" / METRICS).read_text())["history"] == first, "a refusal loses nothing"

    done = in_process(train, "train", *options, long)
    assert done.status == 0, done.err
    assert "goes on to training.iterations=8" in done.out
    history = json.loads((tmp_path / "run" / METRICS).read_text())["history"]
    assert history["loss"][:4] == first["loss"]
    assert history["check_iteration"] == [2, 4, 6, 8]
    assert len(set(history["check_mse"])) == 4, "the learning rate, 0 at the end of the first run, is that of the whole"
    assert "holds this run, finished" in in_process(train, "train", *options, long).out
    fewer = in_process(train, "train", *options, short)
    assert "training.iterations: 8 there, 4 asked for" in fewer.err


def test_a_trained_law_is_fine_tuned_and_never_made_worse(
    in_process: Callable[..., Outcome], positions_only: Path, tmp_path: Path
) -> None:
    options = (*SMALL, *SHORT, f"data.trajectories={positions_only}")
    assert in_process(train, "train", *options, "model.width=4", "output=first").status == 0
    first = json.loads((tmp_path / "first" / METRICS).read_text())
    fine = ("training.init=first", "output=second")
    own = [option for option in options if not option.startswith("model.")]
    done = in_process(train, "train", *own, *fine, "training.learning_rate=3e-1")
    assert done.status == 0, done.err
    assert "model=pcnclaws (width=4), that of training.init=first" in done.out
    second = json.loads((tmp_path / "second" / METRICS).read_text())
    assert second["mse_before_training"] == first["mse"], "it begins with the trained law"
    assert "made nothing better" in done.out
    assert "which is kept" in done.out
    before, after = (read_weights(tmp_path / run / WEIGHTS)[0] for run in ("first", "second"))
    assert all(torch.equal(weight, after[name]) for name, weight in before.items())

    for option, complaint in (
        ("training.init=analytic", "accepted: pretrained, the path of a run folder or of a packaged law, or null"),
        ("training.init=nowhere", "training.init=nowhere is not a folder"),
        ("material=plasticine", "training.init=first was trained for material=elasticity, not plasticine"),
        ("model.width=8", "training.init=first has model=pcnclaws (width=4), not pcnclaws (width=8)"),
    ):
        refused = in_process(train, "train", *own, "training.init=first", option, "output=third")
        assert (refused.status, complaint in refused.err) == (2, True), refused.err


def test_a_truncated_checkpoint_is_never_taken(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    torch.save({"a": torch.arange(1000)}, tmp_path / PREVIOUS)
    whole = (tmp_path / PREVIOUS).read_bytes()
    for size in (0, 10, len(whole) // 2, len(whole) - 1):
        (tmp_path / LAST).write_bytes(whole[:size])
        assert newest_checkpoint(tmp_path) == tmp_path / PREVIOUS
    assert "last.ckpt is damaged and is passed over" in caplog.text
    torch.save({"a": np.dtype}, tmp_path / LAST)
    assert newest_checkpoint(tmp_path) == tmp_path / PREVIOUS, "a file that names code is not loaded"
    (tmp_path / PREVIOUS).unlink()
    assert newest_checkpoint(tmp_path) is None


def test_wrong_input_is_one_line_and_leaves_nothing(
    in_process: Callable[..., Outcome], positions_only: Path, tmp_path: Path
) -> None:
    record = recorded(1)[0]
    write_scenes(tmp_path / "no_nu.h5", [replace(record, parameters={"youngs_modulus": 2e4})])
    write_scenes(tmp_path / "ours.h5", [record])
    falling = simulate_records(
        [lifted(start, 0.15) for start in starts(3)], Laws(NeoHookean(), None), FramePlan(100, EVERY)
    )
    write_scenes(tmp_path / "falling.h5", falling)
    unseen = replace(record, position=np.where(np.arange(len(record.time))[:, None, None], np.nan, record.position))
    write_scenes(tmp_path / "unseen.h5", [replace(unseen, velocity=None, keyframes=None)])
    file = f"data.trajectories={positions_only}"
    for option, message in (
        (("data.trajectories=no_nu.h5",), "parameters.poissons_ratio is missing"),
        (("data.trajectories=nowhere.h5",), "nowhere.h5: no such file"),
        (
            ("data.trajectories=falling.h5",),
            "training.segment_length.last=10 is not accepted: segments",
        ),
        (("data.trajectories=unseen.h5",), "no particle is observed after the first frame"),
        ((file, "training=keyframes"), "training.start=keyframes is not accepted: no scene has keyframes"),
        (("data.trajectories=3",), "data.trajectories=3 is not accepted"),
        (("data.trajectories=ours.h5", "material=sand"), "is of material 'elasticity'; accepted: sand"),
        ((file, "material=sand"), "parameters.friction_angle is missing"),
        ((file, "training.start=keyframe"), "did you mean 'keyframes'"),
        ((file, "training.learning_rate=0"), "training.learning_rate=0.0"),
        ((file, "training.iterations=-1"), "training.iterations=-1 is not accepted; accepted: a whole number from 0"),
        ((file, "regime.scene=1"), "regime.scene=1 is not accepted with regime=multi_scene"),
        ((file, "regime=single_scene", "regime.scene=body_9"), "regime.scene='body_9' is not known"),
        ((file, "model.width=0"), "model.width=0"),
        ((file, "trainer.accumulate_grad_batch=2"), "did you mean 'accumulate_grad_batches'"),
        ((file, "trainer.max_epochs=3"), "trainer.max_epochs is not accepted; accepted: training.iterations"),
        ((file, "trainer.precision=7"), "trainer.precision=7: "),
        ((file, "trainer.limit_val_batches=nan"), "accepted: finite numbers"),
        ((file, "training.average=-1"), "training.average=-1.0 is not accepted; accepted: a number from 0"),
        ((file, "callbacks.early_stopping.patience=0"), "callbacks.early_stopping.patience=0 is not accepted"),
        ((file, "logger=tensorbord"), "did you mean 'tensorboard'"),
        ((file, "logger.name=mlflow"), "logger.name='mlflow' is not known; accepted: csv, tensorboard, wandb"),
    ):
        done = in_process(train, "train", *SMALL, *SHORT, *option, "output=run")
        assert done.status == 2, (option, done)
        assert message in done.err
        assert len(done.err.splitlines()) == 1, done.err
        assert not (tmp_path / "run").exists(), option


def test_lightnings_own_options_reach_its_trainer(
    in_process: Callable[..., Outcome], positions_only: Path, tmp_path: Path
) -> None:
    """A minute improvement is none, so that the second validation without a better one ends the training."""
    early = ("callbacks=early_stopping", "callbacks.early_stopping.patience=2", "callbacks.early_stopping.min_delta=1")
    options = (*SMALL, *LONGER, f"data.trajectories={positions_only}", *early, "logger=csv", "logger.every=1")
    done = in_process(train, "train", *options, *CLIP, "output=run")
    assert done.status == 0, done.err
    folder = tmp_path / "run"
    metrics = json.loads((folder / METRICS).read_text())
    assert metrics["history"]["check_iteration"] == [2, 4, 6]
    assert metrics["training"]["iterations"] == 6
    header, *rows = (folder / "csv" / "metrics.csv").read_text().splitlines()
    assert "loss" in header
    assert len(rows) >= 6
    assert not (folder / "tensorboard").exists()
    assert read_config(folder)["trainer"]["gradient_clip_algorithm"] == "norm"
    assert "holds this run, finished" in in_process(train, "train", *options, "output=run", *CLIP).out


def test_a_logger_that_is_not_installed_says_how_to_get_it(in_process: Callable[..., Outcome]) -> None:
    if find_spec("wandb") is not None:
        pytest.skip("wandb is installed")
    done = in_process(train, "train", "logger=wandb")
    assert done.status == 2
    assert "pip install 'pcnclaws[wandb]', or logger=tensorboard or logger=csv" in done.err


def test_a_training_that_makes_nothing_better_says_so(in_process: Callable[..., Outcome], tmp_path: Path) -> None:
    """Two bodies three times as stiff as they say, checked with one that is as stiff as it says."""
    stiff, honest = recorded(2, Scaled(3.0), keyframes=False), recorded(3, StVKHencky(), keyframes=False)[2:]
    write_scenes(tmp_path / "bodies.h5", [*stiff, *honest])
    done = in_process(
        train, "train", *SMALL, *SHORT, "data.trajectories=bodies.h5", "training.learning_rate=0.02", "output=run"
    )
    assert done.status == 0, done.err
    metrics = json.loads((tmp_path / "run" / METRICS).read_text())
    assert metrics["training"]["better_than_untrained"] is False
    assert metrics["training"]["validation_mse_before_training"] < metrics["training"]["validation_mse"]
    (warning,) = [line for line in done.out.splitlines() if "training made nothing better" in line]
    assert f"{metrics['training']['validation_mse']:.2e} m² after it" in warning


def test_without_iterations_the_run_holds_the_structure_of_the_law_alone(
    in_process: Callable[..., Outcome], positions_only: Path, tmp_path: Path
) -> None:
    options = (*SMALL, f"data.trajectories={positions_only}", "picture=true", "training.iterations=0")
    done = in_process(train, "train", *options, "output=run")
    assert done.status == 0, done.err
    assert "training.iterations=0: nothing is fitted" in done.out
    metrics = json.loads((tmp_path / "run" / METRICS).read_text())
    assert metrics["mse"] == metrics["mse_before_training"] > 0.0
    assert metrics["history"]["loss"] == []
    assert metrics["history"]["check_iteration"] == [0]
    assert (metrics["training"]["iterations"], metrics["training"]["best_iteration"]) == (0, 0)
    assert metrics["training"]["better_than_untrained"] is None
    pictures = {path.name for path in (tmp_path / "run").glob("*.png")}
    assert "predicted_body_3.png" in pictures
    assert "loss.png" not in pictures

    run = load_run(tmp_path / "run")
    torch.manual_seed(0)
    untrained = model_weights(build_model(run.material, {"name": "pcnclaws", "width": 8}))
    weights = model_weights(run.model)
    assert all(torch.equal(weight, weights[name]) for name, weight in untrained.items())
    assert "run holds this run, finished" in in_process(train, "train", *options, "output=run").out


def test_a_run_of_one_scene_is_checked_with_it(
    in_process: Callable[..., Outcome], positions_only: Path, tmp_path: Path
) -> None:
    done = in_process(
        train,
        "train",
        *SMALL,
        *SHORT,
        f"data.trajectories=[{positions_only}]",
        "regime=single_scene",
        "regime.scene=body_1",
        "output=run",
        "training.start=initial",
    )
    assert done.status == 0, done.err
    assert "trains on scene 'body_1' alone" in done.out
    metrics = json.loads((tmp_path / "run" / METRICS).read_text())
    assert [scene["name"] for scene in metrics["scenes"]] == ["body_1", "body_3"]
    assert (tmp_path / "run" / CONFIG).is_file()


def _kill_once(ready: Callable[[], bool], folder: Path, *options: str) -> None:
    """Starts the command in a process of its own and kills it as soon as `ready`."""
    process = subprocess.Popen(
        [sys.executable, "-m", "pcnclaws.train", *options],
        cwd=folder,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )
    deadline = time.monotonic() + 120.0
    while not ready():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.005)
    os.kill(process.pid, signal.SIGKILL)
    process.communicate()


def test_a_sweep_over_the_seed_leaves_one_run_folder_a_job(
    in_process: Callable[..., Outcome], positions_only: Path, tmp_path: Path
) -> None:
    done = in_process(train, "train", *SMALL, *SHORT, f"data.trajectories={positions_only}", "seed=0,1", "--multirun")
    assert done.status == 0, done.err
    weights = sorted((tmp_path / "outputs" / "runs").rglob(WEIGHTS))
    assert len(weights) == 2
    first, second = (read_weights(path)[0] for path in weights)
    assert any(not torch.equal(weight, second[name]) for name, weight in first.items())
    assert all(load_run(path.parent).material.name == "elasticity" for path in weights)
    assert [path.parent.name for path in weights] == ["seed-0", "seed-1"]
    for path in weights:
        options, metrics = _hparams(path.parent / "tensorboard")
        errors = json.loads((path.parent / METRICS).read_text())
        assert options["seed"] == float(path.parent.name[-1])
        assert (options["training.iterations"], options["model.name"]) == (2, "pcnclaws")
        assert metrics["hparams/validation_mse"] == pytest.approx(errors["training"]["validation_mse"])
        assert metrics["hparams/test_mse"] == pytest.approx(errors["mse"])
    table = done.out[done.out.index("sweep of 2 jobs") :]
    assert re.search(r"seed +validation_mse \[m\^2\] +test_mse \[m\^2\] +status +output", table)
    assert [line.split()[0::4] for line in table.splitlines() if "done" in line] == [["0", "seed-0"], ["1", "seed-1"]]
    # the folder of the sweep may become that of a run
    assert in_process(train, "train", *SMALL, *SHORT, f"data.trajectories={positions_only}").status == 0


def _hparams(folder: Path) -> tuple[dict[str, Any], dict[str, float]]:
    """The options and metrics of the one session that TensorBoard finds in a folder."""
    hparams = import_module("tensorboard.plugins.hparams.plugin_data_pb2")  # made by a compiler, without types
    events = EventAccumulator(str(folder))
    events.Reload()
    found = {
        name: hparams.HParamsPluginData.FromString(summary.plugin_data.content)
        for name, summary in events.summary_metadata.items()
        if summary.plugin_data.plugin_name == "hparams"
    }
    assert found["_hparams_/session_end_info"].session_end_info.status == 1, "success"
    options = found["_hparams_/session_start_info"].session_start_info.hparams
    metrics = [info.name.tag for info in found["_hparams_/experiment"].experiment.metric_infos]
    values = {name: getattr(value, value.WhichOneof("kind")) for name, value in options.items()}
    return values, {name: events.Scalars(name)[-1].value for name in metrics}
