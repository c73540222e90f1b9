"""Data sets of graph network simulators are read as trajectories, without running code from their pickles."""

import json
import pickle
import zipfile
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pcnclaws as pc
from pcnclaws.data.trajectory_files import read_trajectories
from pcnclaws.evaluate import evaluate
from pcnclaws.train import train

FRAMES, DT = 5, 0.0025
METADATA = {"dt": DT, "bounds": [[0.1, 0.9]] * 3, "sequence_length": FRAMES, "dim": 3}
BODY = pc.Body.cube(side=0.3, centre=(0.5, 0.3, 0.5), particles_per_edge=6)
PARAMETERS: dict[str, Any] = {"youngs_modulus": 3e5, "poissons_ratio": 0.25, "friction_angle": 30.0}


def motion(frames: int) -> pc.Motion:
    scene = pc.Scene(BODY, pc.analytic_law("sand"), velocity=(0, -2, 0), **PARAMETERS)
    return scene.simulate(steps=5 * (frames - 1), every=5)


def as_objects(*values: Any) -> np.ndarray:
    """As np.savez makes of a tuple of arrays of different shapes."""
    whole = np.empty(len(values), dtype=object)
    whole[:] = values
    return whole


def data_set(folder: Path, frames: int = FRAMES, **metadata: Any) -> np.ndarray:
    position = motion(frames).position.numpy()
    kinds = np.full(position.shape[1], 6)
    trajectories = {f"simulation_trajectory_{k}": as_objects(position + 0.01 * k, kinds) for k in range(2)}
    np.savez_compressed(folder / "train.npz", **trajectories)  # pyright: ignore[reportArgumentType]
    (folder / "metadata.json").write_text(json.dumps(METADATA | metadata))
    return position


def test_each_trajectory_is_a_scene(tmp_path: Path) -> None:
    position = data_set(tmp_path)
    records = read_trajectories(tmp_path / "train.npz", "sand")
    assert [record.name for record in records] == ["simulation_trajectory_0", "simulation_trajectory_1"]
    for k, record in enumerate(records):
        np.testing.assert_array_equal(record.position, position + np.float32(0.01 * k))
        np.testing.assert_allclose(record.time, DT * np.arange(FRAMES), rtol=1e-12)
        assert record.material == "sand"
        assert record.settings.domain == ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))  # walls at the bounds
        assert record.volume.sum() == pytest.approx(0.3**3, rel=1e-4)
    (one,) = read_trajectories(tmp_path / "train.npz", "sand", ["simulation_trajectory_1"])
    assert one.name == "simulation_trajectory_1"


def test_one_array_of_all_and_values_of_materials(tmp_path: Path) -> None:
    position = data_set(tmp_path)
    kinds = np.full(position.shape[1], 6)
    np.savez(tmp_path / "train.npz", gns_data=as_objects(*[as_objects(position, kinds, 0.7)] * 3))
    assert [len(record.time) for record in read_trajectories(tmp_path / "train.npz", "sand")] == [FRAMES] * 3


@pytest.mark.parametrize("protocol", [2, 3, 4])
@pytest.mark.parametrize("kind", ["<f4", ">f8"])
def test_arrays_of_every_protocol_and_order(protocol: int, kind: str, tmp_path: Path) -> None:
    position = data_set(tmp_path)
    content = as_objects(position.astype(kind), np.full(position.shape[1], 6), np.float64(0.5))
    write_member(tmp_path / "train.npz", pickle.dumps(content, protocol=protocol))
    (record,) = read_trajectories(tmp_path / "train.npz", "sand")
    np.testing.assert_array_equal(record.position, position)


def write_member(path: Path, content: bytes) -> None:
    """An .npz of one array of objects with this pickle."""
    file = BytesIO()
    np.lib.format.write_array_header_1_0(file, {"descr": "|O", "fortran_order": False, "shape": (2,)})
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("trajectory.npy", file.getvalue() + content)


class Payload:
    """Leaves a mark where it is unpickled."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> Any:
        return Path.touch, (self.mark,)


HUGE = b"\x80\x04" + b"K\x01r\xff\xff\xff\x7f."  # remembers its two-thousand-millionth value
SHARED = b"\x80\x04" + (b"]q\x00" + b"(" + b"K\x01" * 10_000 + b"e") + b"0" + b"]q\x01(" + b"h\x00" * 10_000 + b"e."
HOSTILE: dict[str, Callable[[Path], bytes]] = {
    "a payload": lambda mark: pickle.dumps(as_objects(Payload(mark), 1)),
    "a payload alone": lambda mark: pickle.dumps(Payload(mark)),
    "a dictionary": lambda mark: pickle.dumps(as_objects({"a": 1}, 1)),
    "texts": lambda mark: pickle.dumps(as_objects("position", "kind")),
    "cut off": lambda mark: pickle.dumps(as_objects(np.zeros((3, 4, 3)), np.zeros(4)))[:-200],
    "memory": lambda mark: HUGE,
    "shared lists": lambda mark: SHARED,
    "a room that it has not": lambda mark: b"\x80\x05\x96" + b"\xff" * 7 + b"\x00.",
    "nothing": lambda mark: b"",
    "two dimensions": lambda mark: pickle.dumps(as_objects(np.zeros((3, 4, 2)), np.zeros(4))),
    "no frame": lambda mark: pickle.dumps(as_objects(np.zeros((0, 4, 3)), np.zeros(4))),
    "not finite": lambda mark: pickle.dumps(as_objects(np.full((3, 9, 3), np.inf), np.zeros(9))),
    "one array": lambda mark: pickle.dumps(as_objects(np.zeros((3, 4, 3)))),
}


@pytest.mark.parametrize("name", list(HOSTILE))
def test_hostile_files_are_one_line_and_leave_no_mark(name: str, tmp_path: Path) -> None:
    data_set(tmp_path)
    mark = tmp_path / "mark"
    write_member(tmp_path / "train.npz", HOSTILE[name](mark))
    with pytest.raises(pc.UserError) as refusal:
        read_trajectories(tmp_path / "train.npz", "sand")
    assert str(refusal.value).count("\n") == 0
    assert "train.npz" in str(refusal.value)
    assert not mark.exists()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "needed for the time between frames"),
        ("{", "needed for the time between frames"),
        ("[1]", "its 'dt' is not a time"),
        ('{"dt": -1}', "its 'dt' is not a time"),
        ('{"dt": 0.1, "bounds": "a"}', "its 'bounds' are not lengths"),
    ],
)
def test_metadata_that_says_nothing_is_one_line(text: str | None, message: str, tmp_path: Path) -> None:
    data_set(tmp_path)
    (tmp_path / "metadata.json").unlink()
    if text is not None:
        (tmp_path / "metadata.json").write_text(text)
    with pytest.raises(pc.UserError, match=message):
        read_trajectories(tmp_path / "train.npz", "sand")


@pytest.mark.slow
def test_a_law_is_trained_on_it_where_the_metadata_names_the_parameters(in_process: Any, tmp_path: Path) -> None:
    data_set(tmp_path, frames=41, **PARAMETERS)
    model = ("model.width=4", "training=initial", "training.iterations=2", "training.check_every=1")
    options = ("material=sand", "picture=false", "threads=1", "data.trajectories=train.npz", "output=run")
    done = in_process(train, "train", *options, *model)
    assert done.status == 0, done.err
    assert (tmp_path / "run" / "weights.safetensors").is_file()


def test_a_file_without_velocities_starts_no_simulation(in_process: Any, tmp_path: Path) -> None:
    data_set(tmp_path, **PARAMETERS)
    arguments = ("material=sand", "law=analytic", "picture=false", "trajectories=train.npz", "output=m.json")
    done = in_process(evaluate, "evaluate", *arguments)
    assert (done.status, done.err.count("\n")) == (2, 1)
    assert "has no initial_velocity" in done.err
