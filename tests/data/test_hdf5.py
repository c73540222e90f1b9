"""The trajectory file: what is written is read again, and whatever is wrong with a file is one clear line."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from recordings import hand_written, recording, written

from pcnclaws.data.hdf5 import read_scenes, scene_names, write_scenes
from pcnclaws.errors import UserError


def _scene(file: h5py.File, name: str = "thrown") -> Any:
    return file[f"scenes/{name}"]


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    records = [recording("a"), replace(recording("b", keyframes=False), velocity=None, initial_velocity=None)]
    path = written(tmp_path / "new" / "folders" / "x.h5", *records)
    for record, found in zip(records, read_scenes(path), strict=True):
        assert (found.name, found.material, found.settings) == (record.name, record.material, record.settings)
        assert (found.parameters, found.source) == (record.parameters, str(path))
        for name in ("time", "position", "volume", "velocity", "initial_velocity"):
            np.testing.assert_array_equal(getattr(found, name), getattr(record, name))
        assert (found.keyframes is None) == (record.keyframes is None)
        for name, values in vars(record.keyframes).items() if record.keyframes else ():
            np.testing.assert_array_equal(getattr(found.keyframes, name), values)
    assert scene_names(path) == ["a", "b"]
    assert [record.name for record in read_scenes(path, ["b"])] == ["b"]
    assert read_scenes(path, with_keyframes=False)[0].keyframes is None
    assert [found.name for found in (tmp_path / "new" / "folders").iterdir()] == ["x.h5"]


def test_the_file_has_the_documented_layout(tmp_path: Path) -> None:
    with h5py.File(written(tmp_path / "x.h5")) as file:
        assert dict(file.attrs) == {"format": "pcnclaws.trajectories", "version": 1}
        scene = _scene(file)
        assert scene.attrs["boundary"] == "slip"
        assert scene.attrs["grid_spacing"] == 0.05
        assert scene["position"].dtype == np.float32
        assert scene["time"].dtype == np.float64
        assert scene["position"].compression == "gzip"
        assert scene["position"].fletcher32
        assert set(scene["keyframes"]) >= {"step", "affine", "deformation"}


def test_a_users_sparse_file_is_read(tmp_path: Path) -> None:
    path = hand_written(tmp_path / "x.h5")
    with h5py.File(path, "a") as file:
        scene = _scene(file, "mine")
        scene.attrs["material"] = np.bytes_("my own rubber")
        scene.attrs["grid_nodes"] = 20.0
        scene["position"][1, 2] = np.nan
        for name in ("youngs_modulus", "poissons_ratio", "friction_angle"):
            del scene.attrs[name]
    record = read_scenes(path)[0]
    assert record.material == "my own rubber"
    assert record.settings.grid_spacing == 1 / 20
    assert not record.parameters
    assert np.isnan(record.position[1, 2]).all()
    assert record.position.dtype == np.float64, "as it is stored"
    assert (record.velocity, record.initial_velocity, record.keyframes) == (None, None, None)
    np.testing.assert_array_equal(record.frame_steps(), [0, 20, 40])


def test_keyframes_take_positions_and_velocities_from_the_frames(tmp_path: Path) -> None:
    path, record = written(tmp_path / "x.h5"), recording()
    with h5py.File(path, "a") as file:
        del _scene(file)["keyframes/position"], _scene(file)["keyframes/velocity"]
    keyframes = read_scenes(path)[0].keyframes
    assert keyframes is not None
    assert record.velocity is not None
    np.testing.assert_array_equal(keyframes.position, record.position[[0, 2]])
    np.testing.assert_array_equal(keyframes.velocity, record.velocity[[0, 2]])
    with h5py.File(path, "a") as file:
        del _scene(file)["velocity"]
    keyframes = read_scenes(path)[0].keyframes
    assert keyframes is not None
    assert keyframes.step.tolist() == [0]


def test_times_between_the_steps_are_refused(tmp_path: Path) -> None:
    path = hand_written(tmp_path / "x.h5")
    with h5py.File(path, "a") as file:
        _scene(file, "mine")["time"][1] = 0.01025
    with pytest.raises(UserError, match=r"x.h5: scene 'mine': its times lie between the steps"):
        read_scenes(path)[0].frame_steps()


def _replaced(name: str, values: object) -> Callable[[h5py.Group], None]:
    def change(scene: h5py.Group) -> None:
        del scene[name]
        scene[name] = values

    return change


def _value(name: str, where: tuple[int, ...], value: float) -> Callable[[h5py.Group], None]:
    def change(scene: Any) -> None:
        scene[name][where] = value

    return change


def _attribute(name: str, value: object) -> Callable[[h5py.Group], None]:
    return lambda scene: scene.attrs.__setitem__(name, value)


def _linked(link: object) -> Callable[[h5py.Group], None]:
    return _replaced("position", link)


def _external_storage(scene: h5py.Group) -> None:
    del scene["volume"]
    scene.create_dataset("volume", (5,), "f4", external=[("elsewhere.bin", 0, h5py.h5f.UNLIMITED)])


def _virtual(scene: h5py.Group) -> None:
    layout = h5py.VirtualLayout((5,), "f4")
    layout[:] = h5py.VirtualSource("elsewhere.h5", "volume", (5,))
    del scene["volume"]
    scene.create_virtual_dataset("volume", layout)


def _absurd_size(scene: h5py.Group) -> None:
    del scene["volume"], scene["position"]
    scene.create_dataset("position", (4, 10**8, 3), "f4", chunks=(1, 100, 3))


def _unknown_filter(scene: h5py.Group) -> None:
    properties = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    properties.set_chunk((5,))
    properties.set_filter(307, h5py.h5z.FLAG_OPTIONAL)
    del scene["volume"]
    h5py.h5d.create(scene.id, b"volume", h5py.h5t.IEEE_F32LE, h5py.h5s.create_simple((5,)), properties)


FAULTS: dict[str, tuple[Callable[[h5py.Group], object], str]] = {
    "no position": (lambda scene: scene.__delitem__("position"), "'position' is missing"),
    "no volume": (lambda scene: scene.__delitem__("volume"), "'volume' is missing"),
    "no time step": (lambda scene: scene.attrs.__delitem__("time_step"), "@time_step is missing"),
    "text for a number": (_attribute("time_step", "fast"), "@time_step is not a finite number"),
    "infinite number": (_attribute("density", np.inf), "@density is not a finite number"),
    "negative time step": (_attribute("time_step", -1.0), "time_step=-1.0 is out of range"),
    "half a grid node": (_attribute("grid_nodes", 20.5), "@grid_nodes=20.5 is not a whole number"),
    "other spacing": (_attribute("grid_spacing", 0.1), "does not fit @grid_nodes"),
    "two of gravity": (_attribute("gravity", [0.0, -9.8]), "@gravity is not three finite numbers"),
    "other boundary": (_attribute("boundary", "slippy"), "did you mean 'slip'"),
    "number for a text": (_attribute("material", 3), "@material is not a text"),
    "lines for a text": (_attribute("material", "a\nb"), "@material is not a text"),
    "nu 0.5": (_attribute("poissons_ratio", 0.5), "poissons_ratio=0.5 is not accepted"),
    "NaN modulus": (_attribute("youngs_modulus", np.nan), "@youngs_modulus is not a finite number"),
    "flat position": (_replaced("position", np.zeros((4, 15))), "'position' has the shape"),
    "no particles": (_replaced("position", np.zeros((4, 0, 3))), "'position' is empty"),
    "other frames": (_replaced("time", np.arange(5.0)), "'position' has the shape"),
    "other particles": (_replaced("volume", np.ones(6)), "'volume' has the shape"),
    "a single number": (_replaced("volume", 1.0), "'volume' has the shape"),
    "whole numbers": (_replaced("position", np.zeros((4, 5, 3), int)), "'position' holds int64"),
    "texts": (_replaced("volume", np.array([b"a"] * 5)), "'volume' holds"),
    "a group": (lambda scene: (scene.__delitem__("volume"), scene.create_group("volume"))[1], "is not a dataset"),
    "time goes back": (_value("time", (2,), 0.0), "'time' is not increasing"),
    "time is NaN": (_value("time", (2,), np.nan), "'time' is not increasing"),
    "NaN at the start": (_value("position", (0, 1), np.nan), "'position' holds numbers that are not finite in the fi"),
    "half a position": (_value("position", (1, 1, 0), np.nan), "'position' holds numbers that are not finite"),
    "infinite position": (_value("position", (1, 1), np.inf), "'position' holds numbers that are not finite"),
    "NaN velocity": (_value("velocity", (1, 1), np.nan), "'velocity' holds numbers that are not finite"),
    "NaN start": (_value("initial_velocity", (1,), np.nan), "'initial_velocity' holds numbers"),
    "huge volume": (_replaced("volume", np.full(5, 1e300)), "'volume' holds numbers that are not finite"),
    "negative volume": (_value("volume", (1,), -1.0), "'volume' is not positive"),
    "keyframes go back": (_value("keyframes/step", (1,), 0), "'keyframes/step' is not increasing"),
    "keyframe inside out": (_value("keyframes/deformation", (0, 0), 0.0), "det F <= 0"),
    "keyframe NaN": (_value("keyframes/affine", (0, 0), np.nan), "not finite"),
    "external link": (_linked(h5py.ExternalLink("elsewhere.h5", "/position")), "'position' is a link"),
    "soft link": (_linked(h5py.SoftLink("/scenes/thrown/velocity")), "'position' is a link"),
    "external storage": (_external_storage, "'volume' is stored in another file"),
    "virtual": (_virtual, "'volume' is stored in another file"),
    "absurd size": (_absurd_size, "'position' claims"),
    "plugin": (_unknown_filter, "'volume' needs an HDF5 plugin"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_wrong_scene_is_one_line(fault: str, tmp_path: Path) -> None:
    change, message = FAULTS[fault]
    path = written(tmp_path / "x.h5")
    with h5py.File(path, "a") as file:
        change(_scene(file))
    with pytest.raises(UserError) as raised:
        read_scenes(path)
    assert str(raised.value).startswith(f"{path}: scene 'thrown': ")
    assert message in str(raised.value)
    assert "\n" not in str(raised.value)


def _foreign(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["data"] = np.zeros(3)


def _newer(path: Path) -> None:
    with h5py.File(hand_written(path), "a") as file:
        file.attrs["version"] = 3


def _linked_scenes(path: Path) -> None:
    with h5py.File(hand_written(path), "a") as file:
        file.move("scenes", "others")
        file["scenes"] = h5py.SoftLink("/others")


def _no_scene(path: Path) -> None:
    with h5py.File(hand_written(path), "a") as file:
        del file["scenes/mine"]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda path: None, "no such file"),
        (lambda path: path.mkdir(), "not a file"),
        (lambda path: path.touch(), "the file is empty"),
        (lambda path: path.write_text("time,x,y,z\n"), "not an HDF5 file"),
        (lambda path: path.write_bytes(written(path).read_bytes()[:-100]), "damaged or unreadable"),
        (_foreign, "not a trajectory file"),
        (_newer, "@version=3 is not known"),
        (_linked_scenes, "'scenes' is a link"),
        (_no_scene, "holds no scene"),
    ],
)
def test_a_wrong_file_is_one_line(make: Callable[[Path], None], message: str, tmp_path: Path) -> None:
    path = tmp_path / "x.h5"
    make(path)
    for read in (read_scenes, scene_names):
        with pytest.raises(UserError, match=message) as raised:
            read(path)
        assert str(raised.value).startswith(f"{path}: ")
        assert "\n" not in str(raised.value)


def test_an_unknown_scene_is_refused_with_the_nearest_name(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="x.h5: scene='thrwn' is not known.*did you mean 'thrown'"):
        read_scenes(written(tmp_path / "x.h5"), ["thrwn"])


def test_damage_is_an_error_or_changes_nothing_that_is_read(tmp_path: Path) -> None:
    whole = written(tmp_path / "x.h5")
    data, damaged = whole.read_bytes(), tmp_path / "damaged.h5"
    random = np.random.default_rng(5)
    for length in random.integers(0, len(data), 60):
        damaged.write_bytes(data[:length])
        with pytest.raises(UserError):
            read_scenes(damaged)
    with h5py.File(whole) as file:
        chunk = _scene(file)["position"].id.get_chunk_info(0)
    for place in chunk.byte_offset + random.integers(0, chunk.size, 20):
        damaged.write_bytes(data[:place] + bytes([data[place] ^ 16]) + data[place + 1 :])
        with pytest.raises(UserError, match="damaged or unreadable"):
            read_scenes(damaged)


def test_damaged_texts_do_not_hang_the_reader(tmp_path: Path) -> None:
    path = written(tmp_path / "x.h5")
    data = path.read_bytes()
    heap = data.index(b"GCOL")
    for place in (heap + 9, heap + 16 + 8, heap + 16 + 12):  # sizes of the heap and of its first object
        path.write_bytes(data[:place] + b"\xff" + data[place + 1 :])
        with pytest.raises(UserError, match="texts are broken"):
            read_scenes(path)


def test_a_failed_write_keeps_the_old_file_and_leaves_nothing_else(tmp_path: Path) -> None:
    path = written(tmp_path / "x.h5")
    before = path.read_bytes()
    with pytest.raises(UserError, match="scene name"):
        write_scenes(path, [recording("fine"), recording("not/fine")])
    with pytest.raises(ValueError, match="different names"):
        write_scenes(path, [recording("same"), recording("same")])
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_a_path_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for path in (tmp_path, tmp_path / "file" / "x.h5"):
        with pytest.raises(UserError, match="cannot be written"):
            written(path)
