"""No room for a file: one line that names it, exit status 1, and nothing half written, whoever writes."""

import errno
import os
import re
import resource
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from conftest import Outcome
from matplotlib.figure import Figure
from training_bodies import recorded

from benchmarks.charts import save
from benchmarks.context import Checkpointed
from pcnclaws.atomic import one_line_writing, replaced_file
from pcnclaws.commands.runs import start_run
from pcnclaws.commands.typed_configs import SimulateConfig
from pcnclaws.data.hdf5 import read_scenes, write_scenes
from pcnclaws.data.observation_files import write_table
from pcnclaws.errors import CannotWrite, UserError
from pcnclaws.evaluation.report import write_metrics
from pcnclaws.rendering.animation import animation
from pcnclaws.rendering.pictures import trajectory_picture
from pcnclaws.simulate import simulate
from pcnclaws.training.checkpoints import LAST, PREVIOUS, AtomicCheckpointIO, newest_checkpoint
from pcnclaws.training.hyperparameters import log_hyperparameters
from pcnclaws.training.weights import write_weights

LIMIT = 2000  # bytes of the largest file


@contextmanager
def small_files() -> Iterator[None]:
    """Lets this process write files of at most LIMIT bytes: EFBIG, where a full disk is ENOSPC."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (LIMIT, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


NUMBERS = np.random.default_rng(0).random((20, 50, 3))
WRITERS: dict[str, Callable[[Path], object]] = {
    "x.h5": lambda path: write_scenes(path, recorded(1)),
    "x.json": lambda path: write_metrics(path, {"numbers": NUMBERS.ravel().tolist()}),
    "x.csv": lambda path: write_table(path, np.arange(20.0), [str(n) for n in range(50)], NUMBERS),
    "x.png": lambda path: trajectory_picture(recorded(1)[0], path),
    "y.png": lambda path: save(Figure(), path),
    "x.gif": lambda path: animation(recorded(1)[0], None, path),
    "x.safetensors": lambda path: write_weights(path, {"a": torch.zeros(2000)}, {}),
    "x.ckpt": lambda path: AtomicCheckpointIO().save_checkpoint({"a": torch.zeros(2000)}, path),
    "config.yaml": lambda path: start_run(path.parent, {"options": "x" * LIMIT}),
    "x.jsonl": lambda path: Checkpointed(path, "f").store("row", "x" * LIMIT),
}


@pytest.mark.parametrize("name", WRITERS)
def test_what_finds_no_room_is_one_line_and_leaves_what_was_there(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_text("what was there")
    with pytest.raises(CannotWrite) as failed, small_files():
        WRITERS[name](path)
    assert str(failed.value) == f"{path} cannot be written (file too large)"
    assert [entry.name for entry in tmp_path.iterdir()] == [name]
    assert path.read_text() == "what was there"
    WRITERS[name](path)
    assert path.stat().st_size > LIMIT, "it would not have fitted"


def test_a_checkpoint_that_finds_no_room_leaves_the_others(tmp_path: Path) -> None:
    for number in range(2):
        AtomicCheckpointIO().save_checkpoint({"number": number}, tmp_path / LAST)
    with pytest.raises(CannotWrite), small_files():
        AtomicCheckpointIO().save_checkpoint({"a": torch.zeros(2000)}, tmp_path / LAST)
    assert sorted(entry.name for entry in tmp_path.iterdir()) == [LAST, PREVIOUS]
    assert newest_checkpoint(tmp_path) == tmp_path / LAST
    assert AtomicCheckpointIO().load_checkpoint(tmp_path / LAST) == {"number": 1}


@pytest.mark.slow
def test_a_command_that_finds_no_room_ends_with_one_line_and_status_1(tmp_path: Path) -> None:
    options = ["material=sand", "scene.side=0.2", "scene.particles_per_edge=8", "simulation.steps=10", "output=out.h5"]
    done = subprocess.run(
        [sys.executable, "-m", "pcnclaws.simulate", *options, "picture=false", "simulation.backend=torch"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"},  # Python itself would leave damaged files
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (LIMIT, LIMIT)),
    )
    assert (done.returncode, done.stderr) == (1, "error: out.h5 cannot be written (file too large)\n")
    assert list(tmp_path.iterdir()) == []


def test_what_a_library_cannot_write_is_one_line_too(in_process: Callable[..., Outcome], tmp_path: Path) -> None:
    def task(config: SimulateConfig) -> None:
        with small_files():
            log_hyperparameters(tmp_path / "run", {"x": "y" * 2 * LIMIT}, {"mse": 1.0})

    done = in_process(task, "simulate")
    assert done.status == 1
    assert done.err == f"error: {tmp_path}/run/tensorboard cannot be written (file too large)\n"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_standard_output_is_one_line_too(tmp_path: Path) -> None:
    code = "from pcnclaws.commands import launcher; launcher.main(lambda config: print('x'), 'simulate')"
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-c", code], cwd=tmp_path, stdout=full, stderr=subprocess.PIPE, text=True
        )
    assert done.returncode == 1
    assert re.fullmatch(r"error: .* cannot be written \(no space left on device\)\n", done.stderr)


@pytest.mark.parametrize("reason", [errno.EACCES, errno.EROFS, errno.ENAMETOOLONG])
def test_a_path_that_cannot_be_written_is_wrong_input(reason: int) -> None:
    with (
        pytest.raises(UserError, match="x.h5: cannot be written .*; accepted: the path of a file"),
        one_line_writing("x.h5"),
    ):
        raise OSError(reason, os.strerror(reason))


def test_a_name_that_is_too_long_is_wrong_input(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="file name too long"), replaced_file(tmp_path / ("x" * 300)):
        pass
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("option", ["output", "law", "scene.mesh", "scene.particles"])
def test_a_path_that_is_too_long_is_wrong_input(option: str, in_process: Any, tmp_path: Path) -> None:
    ends = {"output": ".h5", "scene.mesh": ".obj", "scene.particles": ".npz"}
    outcome = in_process(simulate, "simulate", f"{option}={5000 * 'x'}{ends.get(option, '')}")
    assert outcome.status == 2
    assert "Traceback" not in outcome.err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_on_a_full_file_system(tmp_path: Path) -> None:
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=80k", "tmpfs", str(disk)], capture_output=True)  # noqa: S607
    if mounted.returncode:
        pytest.skip("needs the right to mount a file system")
    try:
        big, small = recorded(8), recorded(1, keyframes=False)
        write_scenes(disk / "x.h5", small)
        with pytest.raises(CannotWrite, match="x.h5 cannot be written .no space left on device."):
            write_scenes(disk / "x.h5", big)
        assert [entry.name for entry in disk.iterdir()] == ["x.h5"]
        assert len(read_scenes(disk / "x.h5")) == 1
    finally:
        subprocess.run(["umount", str(disk)], check=True)  # noqa: S607
