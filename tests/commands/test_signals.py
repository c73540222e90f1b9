"""SIGTERM and SIGINT end every command within seconds: one line, its exit status, nothing half written."""

import os
import signal
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from conftest import Outcome
from training_bodies import recorded

from pcnclaws.commands.runs import WEIGHTS
from pcnclaws.commands.signals import signals_end_it
from pcnclaws.compiled.build import _run
from pcnclaws.data.hdf5 import write_scenes
from pcnclaws.data.locks import written_alone
from pcnclaws.errors import Interrupted, UserError
from pcnclaws.estimate import estimate
from pcnclaws.train import train
from pcnclaws.training.checkpoints import LAST
from pcnclaws.training.weights import read_weights

# Longest that a signal is waited with [s].
PATIENCE = 120.0
STATUS = {signal.SIGINT: (1, "interrupted"), signal.SIGTERM: (143, "terminated")}


def send(number: int, ready: Callable[[], bool] = lambda: True) -> threading.Thread:
    """Sends this process a signal as soon as `ready`."""

    def wait() -> None:
        until = time.monotonic() + PATIENCE
        while not ready():
            if time.monotonic() > until:
                return  # what the test waits for has failed, and says so itself
            time.sleep(0.005)
        os.kill(os.getpid(), number)

    thread = threading.Thread(target=wait)
    thread.start()
    return thread


def _ended(work: Callable[[], object]) -> None:
    """Does work that a signal ends."""
    with pytest.raises(Interrupted), signals_end_it():
        work()


@pytest.mark.parametrize("number", STATUS)
def test_a_signal_ends_a_sweep_with_one_line_and_its_status(number: int, in_process: Callable[..., Outcome]) -> None:
    ran = []

    def task(config: Any) -> None:
        ran.append(config.seed)
        send(number)
        time.sleep(60.0)

    status, words = STATUS[signal.Signals(number)]
    before = signal.getsignal(number)
    assert in_process(task, "train", "--multirun", "seed=1,2,3") == (status, "", f"error: {words}\n")
    assert ran == [1], "the other jobs are not begun"
    assert signal.getsignal(number) is before


def test_a_signal_that_arrives_in_a_callback_is_not_lost() -> None:
    # Python drops what is raised there: of the signals that came while HDF5 compressed, most were lost
    class Thing:
        pass

    def callback(_: object) -> None:
        os.kill(os.getpid(), signal.SIGTERM)
        for _ in range(1000):
            pass

    began = time.monotonic()
    thing = Thing()
    references = [weakref.ref(thing, callback)]
    things = [thing]
    del thing

    def work() -> None:
        things.clear()
        assert references[0]() is None
        time.sleep(60.0)

    _ended(work)
    assert time.monotonic() - began < 30.0


def test_a_second_signal_ends_at_once_and_the_same_one_twice_does_not() -> None:
    code = """if True:
        import os, signal, sys, time
        from pcnclaws.errors import Interrupted
        from pcnclaws.commands.signals import signals_end_it
        with signals_end_it():
            try:
                os.kill(os.getpid(), signal.SIGTERM)
                time.sleep(60.0)
            except Interrupted:
                os.kill(os.getpid(), signal.SIGTERM)
                print("still there", flush=True)
                time.sleep(1.1)
                os.kill(os.getpid(), signal.SIGTERM)
                time.sleep(60.0)
    """
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (-signal.SIGTERM, "still there\n", "")


def test_a_compiler_does_not_outlive_its_process() -> None:
    began = time.monotonic()

    def work() -> None:
        send(signal.SIGTERM)
        _run(["sh", "-c", "sleep 60 & wait"], ["sleep", "60"])

    _ended(work)
    assert time.monotonic() - began < 30.0


def test_a_training_that_is_terminated_keeps_its_checkpoint_and_nobody_else_writes_beside_it(
    in_process: Callable[..., Outcome], tmp_path: Path
) -> None:
    write_scenes(tmp_path / "bodies.h5", recorded(3))
    options = ("material=elasticity", "model.width=8", "data.trajectories=bodies.h5", "threads=1", "picture=false")
    short = ("training.segment_length.first=10", "training.segment_length.last=10", "training.check_every=2")
    options = (*options, *short, "training.iterations=6", "training.batch_segments=2")
    checkpoint = tmp_path / "ended" / "checkpoints" / LAST
    refused = []

    def ready() -> bool:
        if not checkpoint.is_file():
            return False
        try:
            with written_alone(tmp_path / "ended", "output=ended"):
                pass
        except UserError as fault:
            refused.append(str(fault))
        return True

    thread = send(signal.SIGTERM, ready)
    ended = in_process(train, "train", *options, "output=ended")
    thread.join()
    assert ended.status == 143
    assert refused[0].startswith("output=ended is being written by another process")
    assert ended.err == f"error: terminated; the same command goes on from ended/checkpoints/{LAST}\n"
    assert {entry.name for entry in (tmp_path / "ended").iterdir()} == {
        *("checkpoints", "config.yaml", "tensorboard", "weights.safetensors")
    }
    for output in ("ended", "whole"):
        assert in_process(train, "train", *options, f"output={output}").status == 0
    whole, continued = (read_weights(tmp_path / output / WEIGHTS)[0] for output in ("whole", "ended"))
    assert all(torch.equal(weight, continued[name]) for name, weight in whole.items())


@pytest.mark.filterwarnings("ignore:`torch.jit.script` is deprecated:DeprecationWarning")
def test_an_estimation_ends_within_an_iteration(in_process: Callable[..., Outcome], tmp_path: Path) -> None:
    write_scenes(tmp_path / "x.h5", [recorded(1)[0]])
    options = ("material=elasticity", "law=analytic", "observation.file=x.h5", "output=new/e.json", "screening=0")
    thread = send(signal.SIGTERM, (tmp_path / "new" / "e" / "tensorboard").is_dir)
    ended = in_process(estimate, "estimate", *options, "picture=false", "trajectory=false", "simulation.backend=torch")
    thread.join()
    assert ended.status == 143
    assert ended.err.startswith("error: terminated")
    assert ended.err.count("\n") == 1
    assert not (tmp_path / "new" / "e.json").exists()


def test_a_lock_of_a_killed_process_does_not_block(tmp_path: Path) -> None:
    code = """if True:
        import os, signal, sys
        from pathlib import Path
        from pcnclaws.data.locks import written_alone
        with written_alone(Path("run"), "output=run"):
            os.kill(os.getpid(), signal.SIGKILL)
    """
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path)
    assert done.returncode == -signal.SIGKILL
    assert (tmp_path / "run" / ".lock").is_file()
    with written_alone(tmp_path / "run", "output=run"):
        pass
    assert list((tmp_path / "run").iterdir()) == []


def test_a_locked_folder_that_stays_empty_is_removed(tmp_path: Path) -> None:
    with written_alone(tmp_path / "new" / "run", "output=run"):
        assert (tmp_path / "new" / "run").is_dir()
    assert list(tmp_path.iterdir()) == []
