"""Motions for other programs, read back by readers that are not ours."""

import csv
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

import pcnclaws as pc
from pcnclaws.data.hdf5 import write_scenes
from pcnclaws.export import export
from pcnclaws.simulation.particle_fields import FIELDS

SCALARS = ("speed", "hencky_norm", "volume_ratio", "equivalent_strain", "pressure", "von_mises_stress")
FIXED = ("id", "body", "volume", "density", "youngs_modulus", "poissons_ratio", "friction_angle")


@pytest.fixture(scope="module")
def motion() -> pc.Motion:
    """Sand that has met the floor, in three frames."""
    body = pc.Body.cube(side=0.2, centre=(0.5, 0.22, 0.5), particles_per_edge=3)
    scene = pc.Scene(body, pc.analytic_law("sand"), velocity=(0.1, -2.0, 0.0), friction_angle=30.0)
    return scene.simulate(60, 30, torch.float64, deformation=True)


@pytest.fixture(scope="module")
def expected(motion: pc.Motion) -> dict[str, np.ndarray]:
    """The fields of the last frame from formulas of their own."""
    assert motion.deformation is not None
    deformation = motion.deformation[-1].numpy()
    stretch = np.linalg.svd(deformation, compute_uv=False)
    h, J = np.log(stretch), stretch.prod(1)  # noqa: N806  # the textbook's letter
    parameters = motion.record.parameters
    kirchhoff = pc.analytic_law("sand").stress(motion.deformation[-1], **parameters).numpy()  # pyright: ignore[reportArgumentType]
    cauchy = kirchhoff / J[:, None, None]
    mean = np.trace(cauchy, axis1=1, axis2=2) / 3.0
    deviator = cauchy - mean[:, None, None] * np.eye(3)
    assert mean.min() < -100.0  # there is something to see
    return {
        "velocity": motion.velocity[-1].numpy(),
        "speed": np.linalg.norm(motion.velocity[-1].numpy(), axis=1),
        "deformation": deformation,
        "hencky_norm": np.linalg.norm(h, axis=1),
        "volume_ratio": J,
        "equivalent_strain": np.sqrt(2.0 / 3.0) * np.linalg.norm(h - h.mean(1, keepdims=True), axis=1),
        "kirchhoff_stress": kirchhoff,
        "cauchy_stress": cauchy,
        "pressure": -mean,
        "von_mises_stress": np.sqrt(1.5) * np.linalg.norm(deviator, axis=(1, 2)),
        "id": np.arange(27),
        "body": np.zeros(27),
        "volume": motion.record.volume,
        "density": np.full(27, 1000.0),
    } | {name: np.full(27, value) for name, value in parameters.items()}


def close(found: np.ndarray, expected: np.ndarray, tolerance: float = 1e-9) -> None:
    scale = np.abs(expected).max()
    np.testing.assert_allclose(np.asarray(found).reshape(expected.shape), expected, atol=tolerance * scale, rtol=0)


def test_arrays_of_numpy_hold_what_follows_from_the_motion(motion, expected, tmp_path: Path) -> None:
    assert set(expected) == {*FIELDS, *FIXED}
    with np.load(motion.save(tmp_path / "x.npz"), allow_pickle=False) as file:
        for name, values in expected.items():
            close(file[name][-1] if name in FIELDS else np.broadcast_to(file[name], 27), values)


def test_a_table_has_a_line_for_each_particle_of_each_frame(motion, expected, tmp_path: Path) -> None:
    with motion.save(tmp_path / "x.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["frame"], row["id"]) for row in rows] == [(str(f), str(i)) for f in range(3) for i in range(27)]
    assert {float(row["time"]) for row in rows[54:]} == {float(motion.time[-1])}
    close(np.array([[float(row[c]) for c in "xyz"] for row in rows[54:]]), motion.position[-1].numpy())
    for name, values in expected.items():
        flat = values.reshape(27, -1)
        for k in range(flat.shape[1]):
            close(
                np.array([float(row[name if flat.shape[1] == 1 else f"{name}_{k}"]) for row in rows[54:]]), flat[:, k]
            )


def test_plyfile_reads_a_point_cloud_for_each_frame(motion, expected, tmp_path: Path) -> None:
    plyfile = pytest.importorskip("plyfile")
    motion.save(tmp_path / "x.ply", frame=None)
    files = sorted(tmp_path.iterdir())
    assert [file.name for file in files] == ["x_0.ply", "x_1.ply", "x_2.ply"]
    vertices = plyfile.PlyData.read(files[-1])["vertex"]
    close(np.stack([vertices[c] for c in "xyz"], axis=1), motion.position[-1].numpy())
    for name in (*SCALARS, *FIXED):
        close(vertices[name], expected[name])
    close(
        np.stack([vertices[f"cauchy_stress_{k}"] for k in range(9)], axis=1), expected["cauchy_stress"].reshape(27, 9)
    )


def test_meshio_and_pyvista_read_a_grid_for_each_frame(motion, expected, tmp_path: Path) -> None:
    meshio, pyvista = pytest.importorskip("meshio"), pytest.importorskip("pyvista")
    collection = pyvista.get_reader(motion.save(tmp_path / "x.pvd"))
    assert collection.time_values == motion.time.tolist()
    collection.set_active_time_point(2)
    for grid in (collection.read()[0], meshio.read(tmp_path / "x_2.vtu")):
        close(grid.points, motion.position[-1].numpy())
        data = grid.point_data
        for name, values in expected.items():
            close(np.asarray(data[name]), values)


@pytest.mark.parametrize("ending", [".usda", ".usdc", ".usd"])
def test_usd_core_reads_points_with_time_samples(ending: str, motion, expected, tmp_path: Path) -> None:
    usd, geometry = pytest.importorskip("pxr.Usd"), pytest.importorskip("pxr.UsdGeom")
    stage = usd.Stage.Open(str(motion.save(tmp_path / f"x{ending}")))
    assert stage.GetEndTimeCode() == 2
    assert stage.GetTimeCodesPerSecond() == pytest.approx(1.0 / float(motion.time[1]))
    assert geometry.GetStageMetersPerUnit(stage) == 1.0
    points = geometry.Points(stage.GetDefaultPrim())
    for frame in range(3):
        close(np.array(points.GetPointsAttr().Get(frame)), motion.position[frame].numpy(), 1e-6)
    close(np.array(points.GetVelocitiesAttr().Get(2)), expected["velocity"], 1e-6)
    close(np.array(points.GetIdsAttr().Get(2)), expected["id"])
    assert np.array(points.GetWidthsAttr().Get(2)).sum() == pytest.approx(27 * 0.2 / 3)
    primvars = geometry.PrimvarsAPI(points)
    for name in set(expected) - {"id", "velocity"}:
        close(np.array(primvars.GetPrimvar(name).Get(2)), expected[name], 1e-6)


def test_without_usd_core_a_line_says_how_to_install_it(motion, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "pxr.Sdf", None)
    with pytest.raises(pc.UserError, match=r"pip install 'pcnclaws\[usd\]'"):
        motion.save(tmp_path / "x.usd")


def test_values_of_each_particle_are_part_of_the_file(tmp_path: Path, caplog) -> None:
    body = pc.Body.cube(side=0.2, particles_per_edge=2)
    stiffness = torch.linspace(1e5, 2e5, 8)
    scene = pc.Scene(body, pc.analytic_law("elasticity"), youngs_modulus=stiffness)
    motion = scene.simulate(2, 1, deformation=True)
    with np.load(motion.save(tmp_path / "x.npz")) as file:
        close(file["youngs_modulus"], stiffness.numpy(), 1e-6)
        assert "cauchy_stress" in file
    assert not [line for line in caplog.messages if "part of the file" in line]


@pytest.fixture
def exported(in_process, motion, tmp_path: Path):
    write_scenes(tmp_path / "x.h5", [motion.record])
    return lambda *arguments: in_process(export, "export", *arguments)


def test_the_command_writes_what_a_motion_saves(exported, motion, tmp_path: Path) -> None:
    outcome = exported("trajectory=x.h5", "format=npz", "output=y")
    assert (outcome.status, outcome.err) == (0, "")
    assert outcome.out == "wrote y.npz: scene 'cube', 27 particles, frames: 3\n"
    with np.load(tmp_path / "y.npz") as found, np.load(motion.save(tmp_path / "z.npz")) as wanted:
        assert set(found) == set(wanted)
        for name in wanted:
            np.testing.assert_array_equal(found[name], wanted[name])
    assert exported("trajectory=x.h5", "output=s.pvd").out.startswith("wrote s.pvd ... s_2.vtu")
    assert exported("trajectory=x.h5", "output=s.ply", "frame=-1").out.startswith("wrote s.ply: ")


def test_the_stress_is_that_of_the_law_that_is_named(exported, tmp_path: Path) -> None:
    stresses = []
    for law in ("analytic", "pretrained"):
        assert exported("trajectory=x.h5", f"law={law}", f"output={law}.npz").status == 0
        with np.load(tmp_path / f"{law}.npz") as file:
            stresses.append(file["cauchy_stress"])
    error = np.abs(stresses[1] - stresses[0]).max() / np.abs(stresses[0]).max()
    assert 0.0 < error < 0.02


def test_what_a_file_does_not_hold_is_named(in_process, tmp_path: Path, caplog) -> None:
    scene = pc.Scene(pc.Body.cube(side=0.2, particles_per_edge=2), pc.analytic_law("sand"))
    scene.simulate(20, 10).save(tmp_path / "x.h5")
    outcome = in_process(export, "export", "trajectory=x.h5", "output=x.npz")
    assert outcome.status == 0
    for words in (
        "not part of the file: deformation, hencky_norm",
        "F is in 0 of 3 frames (simulate keyframe_every=10",
    ):
        assert words in caplog.text
    with np.load(tmp_path / "x.npz") as file:
        assert "speed" in file
        assert "pressure" not in file


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("output=x.npz",), "trajectory=null and law=null name nothing to export"),
        (("trajectory=x.h5",), "name no format; accepted: format=ply, vtu, usd, npz, csv"),
        (("trajectory=x.h5", "format=vtk"), "did you mean 'vtu'?"),
        (("trajectory=x.h5", "format=ply", "output=x.npz"), "output=x.npz is not of format=ply"),
        (("trajectory=x.h5", "output=x.obj"), "name no format"),
        (("trajectory=x.h5", "output=x.npz", "frame=1"), "frame=1 has no effect with format=npz"),
        (("trajectory=x.h5", "output=x.ply", "frame=7"), "frame=7 does not exist; accepted: -3 to 2"),
        (("trajectory=x.h5", "output=x.ply", "frame=a"), "frame=a is not accepted"),
        (("trajectory=y.h5", "output=x.ply"), "y.h5: no such file"),
        (("trajectory=x.h5", "output=x.npz", "law=pretraned"), "did you mean 'pretrained'?"),
    ],
)
def test_wrong_input_is_one_line(arguments, message: str, exported, tmp_path: Path) -> None:
    outcome = exported(*arguments)
    assert outcome.status == 2
    assert message in outcome.err
    assert outcome.err.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["x.h5"]
