"""The checks of problem=kills: files that are half there, lost or of another content are named, whole ones are not."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from recordings import recording

from benchmarks.kills import _summed
from benchmarks.left_files import broken_files, other_results, results_of
from pcnclaws.atomic import PARTIAL_SUFFIX
from pcnclaws.commands.runs import start_run
from pcnclaws.data.hdf5 import write_scenes
from pcnclaws.training.checkpoints import AtomicCheckpointIO
from pcnclaws.training.weights import write_weights

NAMES = ("run/config.yaml", "run/weights.safetensors", "run/metrics.json", "run/checkpoints/last.ckpt", "data/set.h5")


@pytest.fixture
def left(tmp_path: Path) -> Path:
    """What a training and its data leave."""
    folder = tmp_path / "left"
    run = folder / "run"
    start_run(run, {"material": {"name": "sand"}, "model": {"name": "pcnclaws", "width": 2}})
    write_weights(run / "weights.safetensors", {"a": torch.arange(6.0)}, {})
    (run / "metrics.json").write_text(json.dumps({"mse": 1e-6, "seconds": 3.0}))
    (run / "checkpoints").mkdir()
    AtomicCheckpointIO().save_checkpoint({"state_dict": {"a": torch.ones(3)}}, run / "checkpoints" / "last.ckpt")
    (folder / "data").mkdir()
    write_scenes(folder / "data" / "set.h5", [recording()])
    return folder


def test_whole_files_are_without_fault(left: Path) -> None:
    assert sorted(str(path.relative_to(left)) for path in left.rglob("*.*")) == sorted(NAMES)
    assert broken_files(left) == []
    assert other_results(results_of(left), results_of(left)) == []


@pytest.mark.parametrize("name", NAMES)
def test_a_half_written_file_is_named(name: str, left: Path) -> None:
    path = left / name
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2] if path.suffix != ".yaml" else b"material: {name: sa")
    (fault,) = broken_files(left)
    assert fault.startswith(f"broken: {name} (")
    path.write_bytes(b"")
    assert bool(broken_files(left)) == (path.suffix != ".yaml")  # an empty one is whole, as YAML


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("data/set.h5", lambda path: path.unlink()),
        ("run/weights.safetensors", lambda path: path.unlink()),
        ("run/metrics.json", lambda path: path.unlink()),
        ("data/set.h5", lambda path: write_scenes(path, [recording(count=6)])),
        ("run/weights.safetensors", lambda path: write_weights(path, {"a": torch.arange(6.0) + 1e-7}, {})),
        ("run/metrics.json", lambda path: path.write_text(json.dumps({"mse": 1.0000000000000002e-6}))),
    ],
)
def test_a_result_that_is_lost_or_differs_in_its_last_bit_is_named(
    name: str, change: Callable[[Path], object], left: Path
) -> None:
    expected = results_of(left)
    change(left / name)
    assert other_results(expected, results_of(left)) == [f"other result: {name}"]


def test_time_taken_and_files_in_the_making_do_not_count(left: Path) -> None:
    expected = results_of(left)
    (left / "run" / "metrics.json").write_text(json.dumps({"mse": 1e-6, "seconds": 5.0}))
    (left / "data" / f"set.h5{PARTIAL_SUFFIX}").write_bytes(b"half")
    (left / "run" / "tensorboard").mkdir()
    (left / "run" / "tensorboard" / "curves.h5").write_bytes(b"half")
    assert broken_files(left) == []
    assert other_results(expected, results_of(left)) == []


def test_faults_are_counted_and_kept() -> None:
    rows = {"SIGKILL 0": [], "SIGKILL 1": ["broken: x.h5 (OSError)"], "full disk 0": ["not possible"]}
    found = _summed(rows)
    assert found["ways"]["SIGKILL"] == {"trials": 2, "without_fault": 1, "not_possible": 0}
    assert found["ways"]["full disk"] == {"trials": 1, "without_fault": 0, "not_possible": 1}
    assert found["faults"] == {"SIGKILL 1": ["broken: x.h5 (OSError)"]}
