"""Motions as files: the ending decides the format, and each holds what the motion holds."""

import base64
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
import torch

import pcnclaws as pc
from pcnclaws.data.hdf5 import read_scenes


@pytest.fixture(scope="module", params=[torch.float32, torch.float64])
def motion(request: pytest.FixtureRequest) -> pc.Motion:
    body = pc.Body.cube(side=0.2, centre=(0.5, 0.22, 0.5), particles_per_edge=3)
    scene = pc.Scene(body, pc.analytic_law("sand"), velocity=(0.1, -2.0, 0.0), friction_angle=30.0)
    return scene.simulate(30, 10, request.param, deformation=True)


def test_what_a_motion_holds(motion: pc.Motion) -> None:
    assert motion.time.tolist() == pytest.approx([0.0, 5e-3, 1e-2, 1.5e-2])
    assert motion.position.shape == motion.velocity.shape == (4, 27, 3)
    assert motion.deformation is not None
    assert motion.deformation.shape == (4, 27, 3, 3)
    assert torch.equal(motion.deformation[0], torch.eye(3).to(motion.deformation).expand(27, 3, 3))
    assert len(motion) == 4


def test_a_trajectory_file_in_the_precision_of_the_motion(motion: pc.Motion, tmp_path: Path) -> None:
    (record,) = read_scenes(motion.save(tmp_path / "deep" / "x.h5"))
    for name in ("position", "velocity"):
        values = getattr(record, name)
        np.testing.assert_array_equal(values, getattr(motion, name).numpy())
        assert values.dtype == getattr(motion, name).numpy().dtype
    assert record.parameters["friction_angle"] == 30.0


def test_arrays_of_numpy(motion: pc.Motion, tmp_path: Path) -> None:
    with np.load(motion.save(tmp_path / "x.npz"), allow_pickle=False) as file:
        for name in ("time", "position", "velocity", "deformation"):
            np.testing.assert_array_equal(file[name], getattr(motion, name).numpy())
            assert file[name].dtype == getattr(motion, name).numpy().dtype
        assert file["friction_angle"] == 30.0
        assert str(file["material"]) == "sand"
        assert file["volume"].sum() == pytest.approx(0.008)


def test_a_point_cloud_that_others_read(motion: pc.Motion, tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    cloud = trimesh.load(motion.save(tmp_path / "x.ply", frame=1), process=False)
    np.testing.assert_array_equal(np.asarray(cloud.vertices), motion.position[1].double().numpy())
    data = cloud.metadata["_ply_raw"]["vertex"]["data"]
    np.testing.assert_array_equal(data["velocity_1"].ravel(), motion.velocity[1, :, 1].numpy())


def _vtk_arrays(path: Path) -> dict[str, np.ndarray]:
    """The arrays of a VTK XML file, read as its format is documented."""
    types = {"Float32": "<f4", "Float64": "<f8", "Int32": "<i4", "Int64": "<i8", "UInt8": "u1"}
    arrays = {}
    for array in ElementTree.parse(path).iter("DataArray"):  # noqa: S314  # our own file
        content = base64.b64decode(array.text or "")
        (length,) = np.frombuffer(content[:8], "<u8")
        assert length == len(content) - 8
        values = np.frombuffer(content[8:], types[array.attrib["type"]])
        arrays[array.attrib["Name"]] = values.reshape(-1, int(array.attrib["NumberOfComponents"]))
    return arrays


def test_a_collection_of_all_frames_for_paraview(motion: pc.Motion, tmp_path: Path) -> None:
    path = motion.save(tmp_path / "x.pvd")
    frames = [entry.attrib for entry in ElementTree.parse(path).iter("DataSet")]  # noqa: S314  # our own file
    assert [float(frame["timestep"]) for frame in frames] == motion.time.tolist()
    assert len(list(tmp_path.iterdir())) == 5
    for k, frame in enumerate(frames):
        arrays = _vtk_arrays(tmp_path / frame["file"])
        np.testing.assert_array_equal(arrays["position"], motion.position[k].numpy())
        np.testing.assert_array_equal(arrays["velocity"], motion.velocity[k].numpy())
        assert motion.deformation is not None
        np.testing.assert_array_equal(arrays["deformation"], motion.deformation[k].flatten(1).numpy())
        assert arrays["connectivity"].ravel().tolist() == list(range(27))
        assert arrays["offsets"].ravel().tolist() == list(range(1, 28))
        assert set(arrays["types"].ravel().tolist()) == {1}


def test_one_frame_and_a_picture(motion: pc.Motion, tmp_path: Path) -> None:
    arrays = _vtk_arrays(motion.save(tmp_path / "x.vtu"))
    np.testing.assert_array_equal(arrays["position"], motion.position[-1].numpy())
    assert motion.save(tmp_path / "x.png").read_bytes()[:4] == b"\x89PNG"


def test_other_endings_frames_and_places_are_refused(motion: pc.Motion, tmp_path: Path) -> None:
    for path, frame, message in (
        ("x.xyz", -1, r"x.xyz does not end in a known format; accepted: .h5, .hdf5, .npz"),
        ("x", -1, "does not end in a known format"),
        ("x.ply", 4, r"frame=4 does not exist; accepted: -4 to 3"),
        ("taken/x.npz", -1, "cannot be written"),
    ):
        (tmp_path / "taken").write_text("a file")
        with pytest.raises(pc.UserError, match=message):
            motion.save(tmp_path / path, frame=frame)
    assert [path.name for path in tmp_path.iterdir()] == ["taken"]


def test_values_of_each_particle_that_a_file_cannot_hold_are_named(tmp_path: Path, caplog) -> None:
    body = pc.Body.cube(side=0.2, particles_per_edge=2)
    scene = pc.Scene(body, pc.analytic_law("elasticity"), youngs_modulus=torch.linspace(1e5, 2e5, 8))
    (record,) = read_scenes(scene.simulate(2, 1).save(tmp_path / "x.h5"))
    assert "youngs_modulus" not in record.parameters
    assert any(line.endswith("x.h5: not part of the file: youngs_modulus of each particle") for line in caplog.messages)
