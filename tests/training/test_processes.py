"""Trainings in several processes: together they do what one does, write one run folder, and go on in another number."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from conftest import Outcome
from training_bodies import recorded

from pcnclaws.commands.runs import CONFIG, METRICS, WEIGHTS
from pcnclaws.data.dataset import SegmentDataset
from pcnclaws.data.hdf5 import write_scenes
from pcnclaws.data.segments import SegmentPlan
from pcnclaws.laws.elasticity import NeoHookean
from pcnclaws.train import train
from pcnclaws.training.losses import position_loss
from pcnclaws.training.weights import read_weights

WIDTH = "model.width=8"
SMALL = ("material=elasticity", "threads=1", "picture=false", "training.check_every=2")
SEGMENTS = ("training.batch_segments=3", "training.segment_length.first=10", "training.segment_length.last=10")
GAUSS_NEWTON = ("model=pcnclaws_energy", "training=gauss_newton")


@pytest.fixture(scope="module")
def bodies(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bodies") / "bodies.h5"
    write_scenes(path, [replace(body, material="elasticity") for body in recorded(6, NeoHookean())])
    return path


@pytest.mark.parametrize("count", [2, 3, 5])
def test_shares_of_a_batch_make_up_its_means(count: int) -> None:
    records = [replace(record, position=record.position.copy()) for record in recorded(3, NeoHookean())]
    records[1].position[4:, ::2] = np.nan  # not every segment has as many observations
    plan = SegmentPlan(iterations=4, segments=4, start="keyframes", first=10, last=10, frame_every=None, seed=0)
    whole, parts = SegmentDataset(records, plan), [SegmentDataset(records, plan) for _ in range(count)]
    for number, part in enumerate(parts):
        part.process = number, count
    for i in range(4):
        batch, shares = whole[i], [part[i] for part in parts]
        assert batch.share == (1.0, 1.0)
        assert np.mean([one.share.segments for one in shares]) == pytest.approx(1.0)
        counted = [one for one in shares if one.share.segments]
        assert sum(one.start.scenes.scene_count for one in counted) == batch.start.scenes.scene_count == 4
        moved = batch.start.state.position.expand_as(batch.target)
        mean = sum(
            one.share.observations * position_loss(one.start.state.position.expand_as(one.target), one.target)
            for one in shares
        )
        torch.testing.assert_close(mean / count, position_loss(moved, batch.target))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("trainer.devices=2", *GAUSS_NEWTON), "trainer.devices=2 is not accepted with training.method=gauss_newton"),
        (("trainer.devices=2", "training=kalman"), "trainer.devices=2 is not accepted with training.method=kalman"),
        (("trainer.devices=2", "trainer.num_nodes=2"), "trainer.num_nodes=2 is not accepted; accepted: 1"),
        (("trainer=ddp", "trainer.strategy=fsdp"), "trainer.strategy='fsdp' is not known; accepted: auto, ddp"),
        (("trainer=dpp",), "did you mean 'ddp'"),
    ],
)
def test_what_several_processes_cannot_do_is_refused(
    options, message, in_process, bodies: Path, tmp_path: Path
) -> None:
    done = in_process(train, "train", *SMALL, f"data.trajectories={bodies}", *options, "output=run")
    assert (done.status, len(done.err.splitlines())) == (2, 1), done.err
    assert message in done.err
    assert not (tmp_path / "run").exists()


@pytest.mark.slow
@pytest.mark.parametrize("loss", ["relative", "absolute"])
def test_two_processes_train_as_one_does_to_rounding(
    loss: str, in_process: Callable[..., Outcome], bodies: Path, tmp_path: Path
) -> None:
    """Three segments a batch: one process has two of them. Then both go on, in one process and in two."""
    options = (
        *SMALL,
        WIDTH,
        *SEGMENTS,
        f"training.loss={loss}",
        f"data.trajectories={bodies}",
        "training.learning_rate=1e-3",
    )
    for iterations, devices in ((4, {"one": 1, "two": 2}), (6, {"one": 2, "two": 1})):
        for output, count in devices.items():
            strategy = ("trainer=ddp", f"trainer.devices={count}")
            done = in_process(
                train, "train", *options, *strategy, f"training.iterations={iterations}", f"output={output}"
            )
            assert (done.status, done.err) == (0, "")
            assert done.out.count("iteration ") == 2 if iterations == 4 else 1
        one, two = (json.loads((tmp_path / name / METRICS).read_text()) for name in devices)
        for curve in ("loss", "check_mse"):
            assert len(two["history"][curve]) == len(one["history"][curve])
            np.testing.assert_allclose(two["history"][curve], one["history"][curve], rtol=2e-3)
        weights = [read_weights(tmp_path / name / WEIGHTS)[0] for name in devices]
        for name, weight in weights[0].items():
            torch.testing.assert_close(weights[1][name], weight, rtol=1e-4, atol=1e-5)
    assert {path.name for path in (tmp_path / "two").iterdir()} == {path.name for path in (tmp_path / "one").iterdir()}
    assert (tmp_path / "two" / CONFIG).is_file()


@pytest.mark.slow
def test_a_process_that_is_killed_ends_the_others_and_the_run_goes_on(
    in_process: Callable[..., Outcome], bodies: Path, tmp_path: Path
) -> None:
    options = (*SMALL, WIDTH, *SEGMENTS, f"data.trajectories={bodies}", "training.iterations=2000", "output=run")
    command = [sys.executable, "-m", "pcnclaws.train", *options, "trainer=ddp"]
    with subprocess.Popen(
        command, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    ) as process:
        while not (tmp_path / "run" / "checkpoints" / "last.ckpt").exists():
            assert process.poll() is None
            time.sleep(0.1)
        (other,) = _spawned_by(process.pid)
        os.kill(other, signal.SIGKILL)
        _, said = process.communicate(timeout=60)
    assert process.returncode == 1
    assert (
        said.splitlines()[-1] == "error: a process of the training has gone (exit status -9); the same command goes on"
    )
    assert "Traceback" not in said

    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        first = next(line for line in process.stdout if line.startswith("iteration "))
        assert int(first.split()[1].partition("/")[0]) > 2
        others = _spawned_by(process.pid)
        process.send_signal(signal.SIGTERM)
        _, said = process.communicate(timeout=60)
    assert process.returncode == 143
    assert said.startswith("error: terminated; the same command goes on from ")
    assert not [one for one in others if Path(f"/proc/{one}").exists()]


def _spawned_by(parent: int) -> list[int]:
    """The processes that compute beside a training."""
    found = []
    for path in Path("/proc").glob("[0-9]*"):
        try:
            state, line = (path / "stat").read_text(), (path / "cmdline").read_bytes()
        except OSError:
            continue
        if int(state.rpartition(")")[2].split()[1]) == parent and b"spawn_main" in line:
            found.append(int(path.name))
    return found


def test_an_iteration_of_several_batches_is_one_step_of_the_optimiser(
    in_process: Callable[..., Outcome], bodies: Path, tmp_path: Path
) -> None:
    """Every batch here is the whole motion of one scene: two of them have the mean gradient of one."""
    options = (*SMALL, WIDTH, f"data.trajectories={bodies}", "regime=single_scene", "training=nclaws")
    options += (
        "training.learning_rate=1e-3",
        "training.iterations=4",
        "training.segment_length.first=10",
        "training.segment_length.last=10",
    )
    for output, batches in (("once", 1), ("twice", 2)):
        accumulated = f"trainer.accumulate_grad_batches={batches}"
        done = in_process(train, "train", *options, accumulated, f"output={output}")
        assert done.status == 0, done.err
    once, twice = (json.loads((tmp_path / name / METRICS).read_text())["history"] for name in ("once", "twice"))
    assert once["check_iteration"] == twice["check_iteration"] == [2, 4]
    for curve in ("loss", "check_mse"):
        np.testing.assert_allclose(twice[curve], once[curve], rtol=1e-4)
