"""Bodies from surface meshes: geometry of the filling, what a file may be, and the commands that take one."""

import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from pcnclaws.commands.composition import compose_config
from pcnclaws.commands.configuration import body_from
from pcnclaws.commands.observation_setup import observation_from
from pcnclaws.data.hdf5 import read_scenes
from pcnclaws.errors import UserError
from pcnclaws.geometry.shapes import mesh_particles, particles
from pcnclaws.geometry.winding import lattice_winding
from pcnclaws.laws.materials import material_named
from pcnclaws.simulate import simulate

# A pyramid whose base is missing.
OPEN = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
# A pyramid, one of whose four faces is turned.
TURNED = OPEN + b"f 1 2 3\n"


def saved(path: Path, mesh: trimesh.Trimesh) -> Path:
    mesh.export(path)
    return path


def box(*edges: float) -> trimesh.Trimesh:
    return trimesh.creation.box(edges or (1.0, 1.0, 1.0))


def together(*meshes: trimesh.Trimesh) -> trimesh.Trimesh:
    return trimesh.Scene(meshes).to_mesh()


def tilted(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    return mesh.apply_transform(trimesh.transformations.rotation_matrix(0.7, (1.0, 2.0, 3.0)))


@pytest.mark.parametrize("form", ["stl", "obj", "ply", "off", "glb"])
def test_a_box_in_millimetres_far_from_the_origin_is_the_cube(form: str, tmp_path: Path) -> None:
    mesh = box(80.0, 80.0, 80.0).apply_translation((300.0, -20.0, 7.0))
    body = mesh_particles(saved(tmp_path / f"box.{form}", mesh), (0.4, 0.5, 0.6), 0.3, 7)
    cube = particles("cube", (0.4, 0.5, 0.6), 0.3, 7)
    np.testing.assert_allclose(body.position, cube.position, rtol=1e-14)
    np.testing.assert_allclose(body.volume, cube.volume, rtol=1e-5)
    assert not body.velocity.any()


@pytest.mark.parametrize("per_edge", [10, 11])
def test_the_longest_edge_is_the_side_and_the_others_hold_what_fits(per_edge: int, tmp_path: Path) -> None:
    body = mesh_particles(saved(tmp_path / "x.stl", box(1.0, 4.0, 2.0)), (0.3, 0.4, 0.5), 0.4, per_edge)
    offset = body.position - [0.3, 0.4, 0.5]
    spacing = 0.4 / (per_edge - 1)
    np.testing.assert_allclose(offset.max(0), -offset.min(0), atol=1e-15)
    assert offset[:, 1].max() == pytest.approx(0.2)
    for axis, edge in enumerate((0.1, 0.4, 0.2)):
        along = np.unique(offset[:, axis].round(9))
        np.testing.assert_allclose(np.diff(along), spacing, atol=1e-8)
        assert edge - spacing < np.ptp(along) <= edge + 1e-9
    assert body.volume.sum() == pytest.approx(0.1 * 0.4 * 0.2)
    assert np.ptp(body.volume) == 0.0


def test_a_ball_has_its_volume_and_its_particles_are_those_of_the_sphere(tmp_path: Path) -> None:
    path = saved(tmp_path / "ball.stl", trimesh.creation.icosphere(subdivisions=4, radius=3.0))
    body = mesh_particles(path, side=0.4, particles_per_edge=20)
    distance = np.linalg.norm(body.position - 0.5, axis=1)
    assert distance.max() <= 0.2 * (1.0 + 1e-5)
    assert body.volume.sum() == pytest.approx(math.pi / 6.0 * 0.4**3, rel=0.01)
    assert body.volume[0] == pytest.approx((0.4 / 19) ** 3, rel=0.05), "a particle stands for its cell of the lattice"
    sphere = {*map(tuple, particles("sphere", side=0.4, particles_per_edge=20).position.round(9))}
    lost = sphere - {*map(tuple, body.position.round(9))}
    assert len(sphere) == len(body.position) + len(lost)
    assert len(lost) < 0.03 * len(sphere), "only points between the sphere and its flat triangles"


def test_a_ring_is_filled_but_its_hole_is_not(tmp_path: Path) -> None:
    path = saved(tmp_path / "ring.ply", trimesh.creation.torus(3.5, 1.5, major_sections=96, minor_sections=48))
    body = mesh_particles(path, side=1.0, particles_per_edge=41)
    x, y, z = (body.position - 0.5).T
    assert (np.square(np.hypot(x, y) - 0.35) + np.square(z)).max() <= 0.15**2 * (1.0 + 1e-9)
    assert body.volume.sum() == pytest.approx(2.0 * math.pi**2 * 0.35 * 0.15**2, rel=0.01)
    assert body.volume[0] == pytest.approx(1.0 / 40**3, rel=0.03)


@pytest.mark.parametrize("turn", [False, True])
def test_a_cavity_stays_empty_whichever_way_the_whole_surface_faces(turn: bool, tmp_path: Path) -> None:
    cavity = box(0.6, 0.6, 0.6)
    cavity.invert()
    mesh = together(box(), cavity)
    if turn:
        mesh.invert()
    body = mesh_particles(saved(tmp_path / "x.ply", mesh), side=1.0, particles_per_edge=21)
    depth = np.abs(body.position - 0.5).max(1)
    assert len(depth) == 21**3 - 13**3, "the walls of the cavity are not in the body"
    assert depth.min() == pytest.approx(0.35)
    assert body.volume.sum() == pytest.approx(1.0 - 0.6**3)


def test_the_filling_of_a_tilted_body_is_what_lies_between_its_planes(tmp_path: Path) -> None:
    mesh = tilted(box(3.0, 2.0, 1.0))
    size, middle = float(mesh.extents.max()), mesh.bounds.mean(0)
    body = mesh_particles(saved(tmp_path / "x.ply", mesh), side=1.0, particles_per_edge=30)
    axes = trimesh.transformations.rotation_matrix(0.7, (1.0, 2.0, 3.0))[:3, :3]
    within = np.abs(((body.position - 0.5) * size + middle) @ axes)
    assert (within <= [1.5, 1.0, 0.5]).all()
    assert len(within) == pytest.approx(6.0 * (29 / size) ** 3, rel=0.03)


def test_winding_numbers_are_solid_angles() -> None:
    ring = tilted(trimesh.creation.torus(0.35, 0.15, major_sections=12, minor_sections=7))
    x, y, z = (np.linspace(-0.5, 0.5, count) for count in (10, 11, 12))
    winding = lattice_winding(np.array(ring.vertices), np.array(ring.faces), x, y, z)
    points = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1)
    a, b, c = (ring.triangles[:, corner] - points[..., None, :] for corner in range(3))
    la, lb, lc = (np.linalg.norm(edge, axis=-1) for edge in (a, b, c))
    # the solid angle of a triangle: Van Oosterom and Strackee 1983
    above = np.sum(a * np.cross(b, c), -1)
    below = la * lb * lc + np.sum(a * b, -1) * lc + np.sum(b * c, -1) * la + np.sum(c * a, -1) * lb
    angle = 2.0 * np.arctan2(above, below).sum(-1)
    np.testing.assert_allclose(winding, angle / (4.0 * math.pi), atol=1e-9)
    assert winding.sum() > 100


def test_separate_parts_and_seams_of_texture_are_accepted(tmp_path: Path) -> None:
    parts = [box(), box().apply_translation((2.0, 0.0, 0.0))]
    body = mesh_particles(saved(tmp_path / "two.obj", together(*parts)), side=0.6, particles_per_edge=13)
    assert len(body.position) == 2 * 4 * 5**2, "all faces but those that the boxes turn to each other"
    # the vertices of each face on their own, as at seams
    seams = box()
    seams.unmerge_vertices()
    assert len(mesh_particles(saved(tmp_path / "seams.ply", seams), particles_per_edge=3).position) == 27


def written(content: bytes) -> Callable[[Path], object]:
    return lambda path: path.write_bytes(content)


WRONG: dict[str, tuple[Callable[[Path], object], str]] = {
    "missing.stl": (lambda path: None, "no such file"),
    "folder.stl": (lambda path: path.mkdir(), "no such file"),
    "x.npz": (written(b"PK"), "'.npz' is no known format; accepted: a file ending in .stl"),
    "cut.ply": (written(b"ply\nx"), "cannot be read by trimesh"),
    "wrong_index.obj": (written(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n"), "cannot be read by trimesh"),
    "words.stl": (written(b"no mesh"), "holds no triangle"),
    "empty.stl": (written(b""), "holds no triangle"),
    "degenerate.obj": (written(b"v 0 0 0\nv 1 0 0\nf 1 2 2\n"), "holds no triangle"),
    "nan.obj": (written(OPEN.replace(b"0 0 1", b"0 0 nan")), "not finite"),
    "point.obj": (written(b"v 1 2 3\nv 1 2 3\nv 1 2 3\nf 1 2 3\n"), "all the same"),
    "open.obj": (written(OPEN), "is not watertight"),
    "turned.obj": (written(TURNED), "disagree on what is outside"),
    "twice.obj": (
        lambda path: saved(path, together(box(), box(0.5, 0.5, 0.5))),
        "overlaps with itself",
    ),
    "flat.obj": (written(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 3 2 1\n"), "nothing is inside"),
    "thin.stl": (lambda path: saved(path, tilted(box(1.0, 1.0, 1e-4))), "scene.particles_per_edge=10 is too coarse"),
}


@pytest.mark.parametrize("name", list(WRONG))
def test_a_wrong_mesh_is_one_line(name: str, tmp_path: Path) -> None:
    make, message = WRONG[name]
    make(tmp_path / name)
    with pytest.raises(UserError) as raised:
        mesh_particles(tmp_path / name)
    line = str(raised.value)
    assert message in line
    assert f"scene.mesh={tmp_path / name}" in line
    assert "accepted: " in line
    assert "\n" not in line


@pytest.mark.parametrize("option", [{"side": 0.0}, {"centre": (0.5, 0.5)}, {"particles_per_edge": 1}])
def test_the_lattice_is_checked_as_that_of_a_shape(option: dict, tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"^scene\.\w+=.*accepted"):
        mesh_particles(saved(tmp_path / "x.stl", box()), **option)


def test_without_trimesh_the_line_says_how_to_install_it(in_process, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "trimesh", None)
    outcome = in_process(simulate, "simulate", "scene.mesh=body.stl", "output=x.h5")
    assert outcome.status == 2
    (line,) = outcome.err.splitlines()
    assert "scene.mesh=body.stl" in line
    assert "pip install 'pcnclaws[mesh]'" in line


def test_a_mesh_falls_as_a_body_under_its_name_and_spins_about_the_centre(in_process, tmp_path: Path) -> None:
    saved(tmp_path / "ring.stl", trimesh.creation.torus(3.5, 1.5))
    scene = ["scene.mesh=ring.stl", "scene.centre=[0.5,0.6,0.4]", "scene.velocity=[0,-1,0]", "scene.spin=[0,0,4]"]
    run = ["law=analytic", "simulation.steps=10", "precision=float64", "output=x.h5", "scene.particles_per_edge=12"]
    outcome = in_process(simulate, "simulate", *scene, *run)
    assert outcome.status == 0, outcome.err
    (record,) = read_scenes(tmp_path / "x.h5")
    assert record.name == "ring"
    assert record.initial_velocity is not None
    x, y, _ = (record.position[0] - [0.5, 0.6, 0.4]).T
    np.testing.assert_allclose(record.initial_velocity, np.stack((-4 * y, 4 * x - 1, 0 * x), 1), atol=1e-6)
    n, dt = 10, 5e-4
    fall = [0.0, -n * dt - 9.8 * dt**2 * n * (n + 1) / 2, 0.0]
    np.testing.assert_allclose((record.position[-1] - record.position[0]).mean(0), fall, atol=1e-7)
    assert (tmp_path / "x.png").is_file()


def test_a_mesh_goes_before_a_shape_but_not_beside_particles(in_process, tmp_path: Path) -> None:
    saved(tmp_path / "x.stl", box())
    sphere = compose_config(
        "generate", ["scene=sphere", f"scene.mesh={tmp_path / 'x.stl'}", "scene.particles_per_edge=4"]
    )
    assert len(body_from(sphere.scene).position) == 64
    for arguments, message in (
        (["scene.particles=x.npz"], "scene.mesh=x.stl and scene.particles=x.npz are two bodies"),
        (["scene.centre=[0.5,0.2,0.5]"], "scene.mesh=x.stl scene.centre=[0.5, 0.2, 0.5]"),
        (["output=./x.stl"], "output=x.stl is the file of scene.mesh"),
    ):
        outcome = in_process(simulate, "simulate", "scene.mesh=x.stl", "output=x.h5", *arguments)
        assert outcome.status == 2
        assert message in outcome.err
        assert len(outcome.err.splitlines()) == 1


def test_markers_of_a_table_are_put_on_a_mesh(tmp_path: Path) -> None:
    saved(tmp_path / "x.stl", box())
    table = "time,marker,x,y,z\n0,a,0.45,0.5,0.5\n0,b,0.55,0.52,0.48\n0.01,a,0.45,0.49,0.5\n0.01,b,0.55,0.51,0.48\n"
    (tmp_path / "m.csv").write_text(table)
    given = [f"observation.file={tmp_path / 'm.csv'}", "scene.side=0.3", "scene.particles_per_edge=5"]
    material = material_named("sand")
    of_mesh, of_shape = (
        observation_from(compose_config("estimate", [*given, body]), material)
        for body in (f"scene.mesh={tmp_path / 'x.stl'}", "scene.shape=cube")
    )
    np.testing.assert_allclose(of_mesh.position, of_shape.position, rtol=1e-14)
    np.testing.assert_allclose(of_mesh.volume, of_shape.volume, rtol=1e-6)
    with pytest.raises(UserError, match=r"scene.mesh=FILE"):
        observation_from(compose_config("estimate", given), material)


def test_a_mesh_has_the_lattice_of_the_cube(tmp_path: Path) -> None:
    path = saved(tmp_path / "box.stl", box(80.0, 80.0, 80.0))
    body = mesh_particles(path, (0.4, 0.5, 0.6), 0.3, 6, "centres")
    cube = particles("cube", (0.4, 0.5, 0.6), 0.3, 6, "centres")
    np.testing.assert_allclose(body.position, cube.position, rtol=1e-14)
    plate = mesh_particles(
        saved(tmp_path / "plate.stl", box(1.0, 0.5, 0.01)), side=0.4, particles_per_edge=10, lattice="centres"
    )
    assert np.unique(plate.position[:, 2]).tolist() == [0.5], "thinner than a cell: one layer, in its middle"
    assert len(plate.position) == 50


def test_faces_that_are_there_twice_are_merged_and_said(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    whole = box(2.0, 1.0, 1.0)
    twice = np.concatenate((whole.faces, whole.faces[:3], np.roll(whole.faces[3:5], 1, axis=1)))
    path = saved(tmp_path / "dup.obj", trimesh.Trimesh(whole.vertices, twice, process=False))
    body = mesh_particles(path, particles_per_edge=5)
    (line,) = caplog.messages
    assert line == f"scene.mesh={path}: 5 faces are there more than once: each is taken once"
    once = mesh_particles(saved(tmp_path / "once.obj", whole), particles_per_edge=5)
    np.testing.assert_array_equal(body.position, once.position)
    np.testing.assert_allclose(body.volume, once.volume)


def test_boxes_that_share_a_wall_are_one_body(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    one, other = box(), box().apply_translation((1.0, 0.0, 0.0))
    other.vertices[:, 0] = 2.0 - (other.vertices[:, 0] - 0.5) - 0.5  # mirrored, so that the walls are cut alike
    other.invert()
    body = mesh_particles(saved(tmp_path / "x.obj", together(one, other)), side=0.6, particles_per_edge=13)
    assert len(body.position) == 13 * 7 * 7
    assert body.volume.sum() == pytest.approx(0.6 * 0.3 * 0.3)
    assert "4 faces lie between parts that touch" in caplog.text


def doubled(path: Path) -> Path:
    """A box, each face once from outside and once from inside."""
    mesh = box()
    return saved(path, trimesh.Trimesh(mesh.vertices, np.concatenate((mesh.faces, mesh.faces[:, ::-1])), process=False))


def touching(path: Path) -> Path:
    """Two boxes with one edge in common."""
    return saved(path, together(box(), box().apply_translation((1.0, 1.0, 0.0))))


FAULTS: dict[str, tuple[Callable[[Path], object], tuple[str, ...]]] = {
    "open.obj": (written(OPEN), ("ends at 3 edges", "the first at (0.5, 0, 0) in the file", "fill_holes")),
    "touching.obj": (touching, ("more than two faces meet at 1 edge,", "(0.5, 0.5, 0) in the file", "boolean.union")),
    "turned.obj": (written(TURNED), ("disagree on what is outside at 3 edges", "(0.5, 0, 0)", "fix_normals")),
    "doubled.obj": (doubled, ("each of its faces twice, seen from both sides",)),
    "twice.obj": (
        lambda path: saved(path, together(box(), box(0.5, 0.5, 0.5))),
        (
            "overlaps with itself",
            "at 64 of 1000 lattice points",
            "the first at (-0.1667, -0.1667, -0.1667) in the file",
        ),
    ),
}


@pytest.mark.parametrize("name", list(FAULTS))
def test_a_fault_of_a_mesh_has_a_number_a_place_and_a_way_out(name: str, tmp_path: Path) -> None:
    make, words = FAULTS[name]
    make(tmp_path / name)
    with pytest.raises(UserError) as raised:
        mesh_particles(tmp_path / name)
    for word in words:
        assert word in str(raised.value)


def test_the_way_out_mends_the_mesh(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "x.obj").write_bytes(OPEN)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UserError) as raised:
        mesh_particles("x.obj")
    code = str(raised.value).split('python -c "')[1].split('"')[0]
    subprocess.run([sys.executable, "-c", code], check=True)
    body = mesh_particles("mended.ply", particles_per_edge=5)
    assert body.volume.sum() == pytest.approx(0.5**3 / 6.0)
