"""Surfaces around particles are watertight and hold the volume that the particles stand for."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

import pcnclaws as pc
from pcnclaws.export import export
from pcnclaws.geometry.reconstructed_surface import reconstructed_surface

NEEDED = "needs pip install 'pcnclaws[surface]'"
BODIES = {
    "cube": pc.Body.cube(side=0.5, centre=(0.5, 0.5, 0.5), particles_per_edge=12),
    "sphere": pc.Body.sphere(side=0.5, centre=(0.5, 0.5, 0.5), particles_per_edge=16),
    "torus": pc.Body.shape("torus", side=0.5, centre=(0.5, 0.5, 0.5), particles_per_edge=24),
}


def arrays(body: pc.Body) -> tuple[np.ndarray, np.ndarray]:
    return np.asarray(body.position, np.float64), np.asarray(body.volume, np.float64)


def mesh_of(position: np.ndarray, volume: np.ndarray) -> trimesh.Trimesh:
    pytest.importorskip("skimage", reason=NEEDED)
    vertices, faces = reconstructed_surface(position, volume)
    return trimesh.Trimesh(vertices, faces, process=False)


@pytest.mark.parametrize("name", list(BODIES))
def test_a_body_lies_in_a_watertight_mesh_of_its_volume(name: str) -> None:
    position, volume = arrays(BODIES[name])
    mesh = mesh_of(position, volume)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume == pytest.approx(volume.sum(), rel=0.04)  # positive: normals point outwards
    assert mesh.euler_number == (0 if name == "torus" else 2)


def test_a_body_that_has_been_turned_sheared_and_jostled_keeps_its_volume() -> None:
    position, volume = arrays(BODIES["cube"])
    rng = np.random.default_rng(0)
    shear = np.array([[1.0, 0.4, 0.0], [0.0, 1.0, 0.2], [0.0, 0.0, 1.0]])
    turn, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    jostled = position + 0.2 * np.cbrt(volume.mean()) * rng.standard_normal(position.shape)
    mesh = mesh_of(jostled @ (turn @ shear).T, volume)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(volume.sum(), rel=0.05)


def test_two_bodies_are_two_surfaces() -> None:
    position, volume = arrays(BODIES["sphere"])
    mesh = mesh_of(np.concatenate((position, position + 1.0)), np.concatenate((volume, volume)))
    assert mesh.body_count == 2
    assert mesh.is_watertight


def test_particles_that_are_no_body_are_one_line() -> None:
    pytest.importorskip("skimage", reason=NEEDED)
    far = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    with pytest.raises(pc.UserError, match="surface=true: the particles are too far apart to have a surface"):
        reconstructed_surface(far, np.full(2, 1e-3))
    with pytest.raises(pc.UserError, match="surface=true: the particles spread over .* cells"):
        reconstructed_surface(1e3 * np.array([[0.0, 0, 0], [1, 1, 1]]), np.full(2, 1e-6))


@pytest.fixture
def recorded(tmp_path: Path) -> None:
    scene = pc.Scene(BODIES["sphere"], pc.analytic_law("elasticity"), velocity=(0, -2, 0))
    scene.simulate(steps=20, every=10).save(tmp_path / "x.h5")


def test_the_command_leaves_a_mesh_for_each_frame(recorded: None, tmp_path: Path, in_process: Any) -> None:
    pytest.importorskip("skimage", reason=NEEDED)
    done = in_process(export, "export", "trajectory=x.h5", "surface=true", "output=s.ply")
    assert done.status == 0, done.err
    assert "s_0.ply ... s_2.ply: surface of scene" in done.out
    for k in range(3):
        mesh = trimesh.load_mesh(tmp_path / f"s_{k}.ply")
        assert mesh.is_watertight
        assert mesh.volume == pytest.approx(float(BODIES["sphere"].volume.sum()), rel=0.04)
    assert in_process(export, "export", "trajectory=x.h5", "surface=true", "frame=-1", "output=last.ply").status == 0
    assert (tmp_path / "last.ply").read_bytes() == (tmp_path / "s_2.ply").read_bytes()


def test_wrong_input_is_one_line(
    recorded: None, tmp_path: Path, in_process: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    for arguments, message in (
        (("output=x.csv",), "surface=true has no effect with format=csv"),
        (("output=x.ply", "law=analytic"), "law=analytic has no effect with surface=true"),
    ):
        outcome = in_process(export, "export", "trajectory=x.h5", "surface=true", *arguments)
        assert (outcome.status, outcome.err.count("\n")) == (2, 1)
        assert message in outcome.err
    monkeypatch.setitem(sys.modules, "skimage.measure", None)
    outcome = in_process(export, "export", "trajectory=x.h5", "surface=true", "output=x.ply")
    assert "surface=true needs scikit-image, which is not installed; accepted: pip install 'pcnclaws[surface]'" in (
        outcome.err
    )
