"""Trajectories of other formats: read back as they were written, by us and by others, and refused with one line."""

import base64
import json
import resource
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
import torch

import pcnclaws as pc
from pcnclaws.data.point_files import read_point_file
from pcnclaws.data.start_velocity import with_start_velocity
from pcnclaws.data.trajectory_files import read_trajectories
from pcnclaws.errors import UserError
from pcnclaws.evaluate import evaluate
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.render import render
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.training.sources import own_scenes

SAND = {"youngs_modulus": 3e5, "poissons_ratio": 0.2, "friction_angle": 30.0}


@pytest.fixture(scope="module")
def motion() -> pc.Motion:
    """Sand that spins and meets the floor of a domain of its own."""
    body = pc.Body.cube(side=0.2, centre=(1.0, 0.25, 0.5), particles_per_edge=4)
    settings = pc.Settings(domain=((0, 0, 0), (2, 1, 1)), time_step=4e-4, friction=0.2, density=1500.0)
    law = pc.analytic_law("sand")
    scene = pc.Scene(body, law, velocity=(0.5, -2, 0), spin=(0, 0, 3), settings=settings, name="mine").with_(**SAND)
    return scene.simulate(90, 30, torch.float64)


def saved(motion: pc.Motion, folder: Path, ending: str) -> Path:
    """The path by which the saved motion is read."""
    motion.save(folder / f"x{ending}", frame=None)
    return folder / ("x_*.ply" if ending == ".ply" else f"x{ending}")


@pytest.mark.parametrize("ending", [".npz", ".pvd", ".ply"])
def test_a_motion_comes_back_to_the_last_bit(ending: str, motion, tmp_path: Path) -> None:
    (found,) = read_trajectories(saved(motion, tmp_path, ending))
    record: SceneRecord = motion.record
    assert (found.name, found.material) == ("mine", "sand")
    assert found.settings == record.settings
    assert found.parameters == record.parameters
    for name in ("time", "position", "velocity", "initial_velocity", "initial_affine", "volume"):
        np.testing.assert_array_equal(getattr(found, name), getattr(record, name))
        assert getattr(found, name).dtype == np.float64
    assert found.density is None
    assert found.keyframes is None


@pytest.mark.parametrize("ending", [".npz", ".pvd", ".ply"])
def test_evaluate_train_and_render_take_them(ending: str, motion, in_process, tmp_path: Path) -> None:
    path = str(saved(motion, tmp_path, ending))
    outcome = in_process(
        *(evaluate, "evaluate", "law=analytic", f"trajectories={path}", "output=m.json"),
        *("picture=false", "precision=float64"),
    )
    assert outcome.status == 0, outcome.err
    assert json.loads((tmp_path / "m.json").read_text())["mse"] < 1e-24
    scenes = own_scenes([Path(path)], MATERIALS["sand"])
    np.testing.assert_array_equal(scenes.training[0].position, motion.record.position)
    assert in_process(render, "render", f"trajectory={path}", "size=80", "times=1", "colour=speed").status == 0


def foreign(folder: Path, ids: tuple[int, ...] = (7, 3, 5), time: str = "comment time {}\n") -> Path:
    """A series of point clouds as others write them: text, no settings, one particle not seen in the end."""
    for frame, seen in enumerate(((0, 1, 2), (2, 0))):
        rows = [f"{0.3 + 0.1 * k} {0.5 - 0.1 * frame} 0.5 {ids[k]} 0.001 3e5 0.2 30 255" for k in seen]
        names = ("x", "y", "z", "id", "volume", *SAND, "red")
        header = ["ply", "format ascii 1.0", time.format(0.01 * frame).strip(), f"element vertex {len(rows)}"]
        header += [
            f"property {'int' if name == 'id' else 'uchar' if name == 'red' else 'double'} {name}" for name in names
        ]
        lines = [*filter(None, header), "element face 0", "property list uchar int vertex_indices", "end_header", *rows]
        (folder / f"f{9 + frame}.ply").write_text("\n".join(lines) + "\n")
    return folder / "f*.ply"


def test_point_clouds_of_others(tmp_path: Path, caplog) -> None:
    (record,) = read_trajectories(foreign(tmp_path), "sand")
    assert record.material == "sand"
    assert record.parameters == SAND
    np.testing.assert_allclose(record.position[0, :, 0], [0.3, 0.4, 0.5])
    np.testing.assert_allclose(record.position[1, :, 1], [0.4, np.nan, 0.4])
    assert record.initial_velocity is None
    assert [line.partition(": ")[2] for line in caplog.messages] == ["not read: red"]


@pytest.mark.parametrize("binary", [True, False])
def test_grids_that_meshio_wrote(binary: bool, tmp_path: Path) -> None:
    meshio = pytest.importorskip("meshio")
    points = np.random.default_rng(1).uniform(0.3, 0.7, (5, 3))
    for k in range(2):
        data = {"volume": np.full(5, 1e-4), "velocity": np.ones((5, 3)), **{n: np.full(5, v) for n, v in SAND.items()}}
        mesh = meshio.Mesh(points + 0.01 * k, [("vertex", np.arange(5)[:, None])], point_data=data)
        meshio.vtu.write(tmp_path / f"g{k}.vtu", mesh, binary=binary)
    sets = "".join(f'<DataSet timestep="{0.01 * k}" file="g{k}.vtu"/>' for k in range(2))
    (tmp_path / "g.pvd").write_text(f'<VTKFile type="Collection"><Collection>{sets}</Collection></VTKFile>')
    (record,) = read_trajectories(tmp_path / "g.pvd", "sand")
    np.testing.assert_allclose(record.position[1], points + 0.01, atol=1e-9)
    assert record.parameters == SAND


def test_series_that_cannot_be_read_are_one_line(motion, tmp_path: Path) -> None:
    good = {"time": motion.time, "position": motion.position, "volume": np.full(64, 1e-4)}
    for change, message in (
        ({"time": None}, "'time' is missing"),
        ({"position": motion.position[0]}, "'position' has the shape (64, 3)"),
        ({"volume": np.full(3, 1e-4)}, "'volume' has the shape (3,); accepted: numbers (64)"),
        ({"volume": np.zeros(64)}, "'volume' is not positive everywhere"),
        ({"time": np.zeros(4)}, "its times are not increasing"),
        ({"time_step": -1.0}, "simulation.time_step=-1"),
        ({"gravity": [1.0]}, "'gravity' is not accepted; accepted: three finite numbers"),
        ({"youngs_modulus": -1.0}, "youngs_modulus"),
        ({"youngs_modulus": np.arange(64) + 1.0}, "'youngs_modulus' differs between the particles"),
        ({"velocity": motion.velocity[:2]}, "'velocity' has the shape (2, 64, 3)"),
        ({"material": np.array(0x7FFFFFFF, np.uint32).view("<U1")}, "'material' is not a text of one line"),
        ({"name": np.array("a\nb")}, "'name' is not a text of one line"),
        ({"domain": [[0, 0, 0], [1e308] * 3], "grid_spacing": 1e-300}, "does not fit the domain"),
        ({"material": np.array([{}], dtype=object)}, "not an .npz file of numbers, or damaged"),
    ):
        arrays = {name: np.asarray(value) for name, value in (good | change).items() if value is not None}
        np.savez(tmp_path / "x.npz", **arrays)  # pyright: ignore[reportArgumentType]
        with pytest.raises(UserError) as caught:
            read_trajectories(tmp_path / "x.npz")
        assert message in str(caught.value)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "damage", "message"),
    [
        ("x.pvd", lambda text: text.replace(b"x_1.vtu", b"/etc/passwd"), "accepted: files in its folder"),
        ("x.pvd", lambda text: text.replace(b"x_1.vtu", b"y.vtu"), "y.vtu: no such file"),
        ("x.pvd", lambda text: text.replace(b"x_1.vtu", b"y" * 5000), "no such file"),
        ("x.pvd", lambda text: text.replace(b"<VTK", b"<!DOCTYPE x><VTK"), "declares a document type"),
        ("x.pvd", lambda text: text[:60], "not a VTK XML file, or damaged"),
        ("x_1.vtu", lambda text: text.replace(b'format="binary"', b'format="appended"'), "not appended"),
        ("x_1.vtu", lambda text: text.replace(b"</DataArray>", b"AAAA</DataArray>"), "is damaged"),
        ("x_1.vtu", lambda text: text.replace(b"pcnclaws {", b"pcnclaws {{"), "its line 'pcnclaws ...' is damaged"),
        ("x_1.ply", lambda text: text[:-9], "holds less than 64 vertices"),
        (
            "x_1.ply",
            lambda text: text.replace(b"vertex 64", b"vertex 9999999999"),
            "holds less than 9999999999 vertices",
        ),
        ("x_1.ply", lambda text: text.replace(b"property double y", b"property list y"), "is not accepted"),
        ("x_1.ply", lambda text: text.replace(b"comment", b"obj_info"), "does not say its time"),
        ("x_1.ply", lambda text: b"\x00" * 9, "not a PLY file"),
    ],
)
def test_damaged_series_are_one_line(name: str, damage, message: str, motion, tmp_path: Path) -> None:
    path = saved(motion, tmp_path, ".ply" if name.endswith("ply") else ".pvd")
    (tmp_path / name).write_bytes(damage((tmp_path / name).read_bytes()))
    with pytest.raises(UserError) as caught:
        read_trajectories(path)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_collection_that_unpacks_beyond_the_memory_is_refused(tmp_path: Path) -> None:
    """40 times 12 MB of zeros, which a file of some kB holds."""
    count = 10**6
    block = zlib.compress(bytes(12 * count))
    parts = (struct.pack("<4I", 1, 12 * count, 0, len(block)), block)
    points = "".join(base64.b64encode(part).decode() for part in parts)
    array = f'<DataArray type="Float32" NumberOfComponents="3" format="binary">{points}</DataArray>'
    root = '<VTKFile type="UnstructuredGrid" compressor="vtkZLibDataCompressor">'
    (tmp_path / "z.vtu").write_text(f"{root}<Piece><Points>{array}</Points></Piece></VTKFile>")
    sets = "".join(f'<DataSet timestep="{k}" file="z.vtu"/>' for k in range(40))
    (tmp_path / "z.pvd").write_text(f'<VTKFile type="Collection"><Collection>{sets}</Collection></VTKFile>')
    pages, before = int(Path("/proc/self/statm").read_text().split()[0]), resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + 2**29, before[1]))
    try:
        with pytest.raises(UserError, match="too much for the memory here") as refused:
            read_trajectories(tmp_path / "z.pvd", "sand")
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)
    assert "\n" not in str(refused.value)


def test_single_frames_are_refused_with_what_is_accepted(motion, tmp_path: Path) -> None:
    for name, message in (("x.ply", "accepted: the series, such as x*.ply"), ("x.vtu", "accepted: the .pvd file")):
        with pytest.raises(UserError, match=".*") as caught:
            read_trajectories(motion.save(tmp_path / name))
        assert message in str(caught.value)
    for name in ("n_*.ply", "n.pvd", "n.npz"):
        with pytest.raises(UserError, match="no such file|matches 0 files"):
            read_trajectories(tmp_path / name)


def test_a_body_from_a_point_cloud(motion, tmp_path: Path, caplog) -> None:
    body = read_point_file(motion.save(tmp_path / "x.ply", frame=1))
    np.testing.assert_array_equal(body.position, motion.position[1].numpy())
    np.testing.assert_array_equal(body.velocity, motion.velocity[1].numpy())
    assert body.volume.sum() == pytest.approx(0.008)
    assert body.density is not None
    assert "not read: " in caplog.text
    (tmp_path / "y.ply").write_bytes((tmp_path / "x.ply").read_bytes().replace(b"double volume", b"double volumes"))
    with pytest.raises(UserError, match="'volume' is missing"):
        read_point_file(tmp_path / "y.ply")


def test_our_own_table_is_read_back(motion, tmp_path: Path) -> None:
    (record,) = read_trajectories(motion.save(tmp_path / "m.csv"), "sand")
    np.testing.assert_allclose(record.position, motion.position.numpy(), rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(record.volume, motion.record.volume, rtol=1e-8)
    assert record.initial_velocity is not None
    np.testing.assert_allclose(record.initial_velocity, motion.velocity[0].numpy(), rtol=1e-8)
    np.testing.assert_allclose(record.time, motion.time.numpy(), atol=1e-12)


def tracked(path: Path, steps: int = 3, noise: float = 0.0) -> np.ndarray:
    """A table of a thrown, spinning cube as a tracker writes it, lines in any order, one point not seen at the end."""
    axis = np.linspace(0.4, 0.6, 4)
    start = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    velocity = np.array([1.0, -0.5, 0.2]) + np.cross([0.0, 3.0, 1.0], start - start.mean(0))
    random, rows = np.random.default_rng(1), []
    for k in range(steps):
        time = 5e-3 * k
        place = start + time * velocity + 0.5 * time * (time + 5e-4) * np.array([0.0, -9.8, 0.0])
        place = place + noise * random.normal(size=place.shape)
        rows += [(time, number, *point) for number, point in enumerate(place) if k < steps - 1 or number != 7]
    order = random.permutation(len(rows))
    lines = [",".join(f"{value:.12g}" for value in rows[k]) for k in order]
    path.write_text("\n".join(['# pcnclaws {"material": "elasticity"}', "time,id,x,y,z", *lines]) + "\n")
    return velocity


def test_a_table_of_positions_alone_says_what_is_taken_for_the_rest(tmp_path: Path, caplog) -> None:
    velocity = tracked(tmp_path / "t.csv")
    (record,) = read_trajectories(tmp_path / "t.csv", "elasticity")
    assert record.position.shape == (3, 64, 3)
    assert np.isnan(record.position[2, 7]).all()
    assert "holds no volumes; each particle is given the cube of the median distance to its nearest, (0.0667 m)^3" in (
        caplog.text
    )
    np.testing.assert_allclose(record.volume, (0.2 / 3) ** 3, rtol=1e-6)
    found = with_start_velocity(record)
    assert found.initial_velocity is not None
    assert found.initial_affine is not None
    np.testing.assert_allclose(found.initial_velocity, velocity, atol=1e-8)
    np.testing.assert_allclose(found.initial_affine[0] @ [1.0, 0.0, 0.0], np.cross([0.0, 3.0, 1.0], [1.0, 0.0, 0.0]))
    assert "are those of a flight with (1, -0.5, 0.2) m/s and a spin of (" in caplog.text
    assert with_start_velocity(found) is found


def test_noise_of_the_positions_hardly_reaches_the_start_velocity(tmp_path: Path) -> None:
    """1 mm on 64 points at two times of 10 ms: some 0.02 m/s on the mean velocity."""
    tracked(tmp_path / "t.csv", noise=1e-3)
    found = with_start_velocity(read_trajectories(tmp_path / "t.csv", "elasticity")[0]).initial_velocity
    assert found is not None
    assert np.linalg.norm(found.mean(0) - [1.0, -0.5, 0.2]) < 0.06


def test_tables_that_cannot_be_read_are_one_line(tmp_path: Path) -> None:
    row = "0,1,0.5,0.5,0.5"
    for text, message in (
        ("time,x,y\n0,1,2\n", "the column 'z' is missing"),
        (f"time,id,x,y,y,z\n{row},0\n", "a column is there twice"),
        (f"time,id,x,y,z\n{row}\n0,2,a,0,0\n", "a line does not hold 5 numbers"),
        (f"time,id,x,y,z\n{row},7\n", "no line of 5 numbers"),
        ("time,id,x,y,z\n", "no line of 5 numbers"),
        ("time,id,x,y,z\nnan,1,0,0,0\n", "'time' holds numbers that are not finite"),
        ("time,id,x,y,z\n0,inf,0,0,0\n", "'id' holds something that is no number of a particle"),
        (f"time,id,x,y,z\n{row}\n", "the field 'volume' is missing"),
        (f"# pcnclaws {{\ntime,id,x,y,z\n{row}\n", "is damaged"),
        ("", "the column 'time' is missing"),
    ):
        (tmp_path / "x.csv").write_text(text)
        with pytest.raises(UserError) as caught:
            read_trajectories(tmp_path / "x.csv", "sand")
        assert message in str(caught.value)
        assert "\n" not in str(caught.value)
