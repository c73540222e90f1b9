"""Bodies as particles, and point files."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recordings import hand_written, recording, written

from pcnclaws.data.point_files import read_point_file
from pcnclaws.errors import UserError
from pcnclaws.geometry.implicit_shapes import BODIES
from pcnclaws.geometry.shapes import particles, spin_velocity


def test_the_cube_lattice_includes_the_faces() -> None:
    cube = particles()
    assert cube.position.shape == (1000, 3)
    assert not cube.velocity.any()
    assert cube.position.min(0).tolist() == [0.25] * 3
    assert cube.position.max(0).tolist() == [0.75] * 3
    np.testing.assert_allclose(cube.volume, 0.125 / 1000, rtol=1e-14)
    assert len(np.unique(cube.position, axis=0)) == 1000


def test_the_sphere_has_its_exact_volume_and_lies_in_it() -> None:
    sphere = particles("sphere", centre=(0.4, 0.5, 0.6), side=0.4, particles_per_edge=11)
    distance = np.linalg.norm(sphere.position - [0.4, 0.5, 0.6], axis=1)
    assert distance.max() == pytest.approx(0.2)
    assert len(distance) > 400
    assert sphere.volume.sum() == pytest.approx(math.pi / 6 * 0.4**3)
    np.testing.assert_allclose(sphere.position.mean(0), [0.4, 0.5, 0.6], atol=1e-12)


VOLUMES = {
    "torus": 2.0 * math.pi**2 * 0.35 * 0.15**2,
    "star": 5.0 * 0.5 * 0.25 * math.sin(math.pi / 5.0) * 0.4,
    "twisted_bar": 0.4**2,
    "hollow_box": 1.0 - 0.6**3,
}


@pytest.mark.parametrize(("shape", "volume"), VOLUMES.items())
def test_bodies_have_their_volume_in_equal_shares(shape: str, volume: float) -> None:
    body = particles(shape, side=0.5, particles_per_edge=20)
    assert body.volume.sum() == pytest.approx(volume * 0.5**3, rel=5e-3)
    assert np.ptp(body.volume) == 0.0
    assert body.volume[0] == pytest.approx((0.5 / 20) ** 3, rel=0.05), "a particle stands for its cell of the lattice"


@pytest.mark.parametrize("shape", sorted(BODIES))
def test_bodies_lie_in_their_box_and_are_as_symmetric_as_they_look(shape: str) -> None:
    body = particles(shape, centre=(0.4, 0.5, 0.6), side=0.6, particles_per_edge=20)
    offset = body.position - [0.4, 0.5, 0.6]
    assert np.abs(offset).max() < 0.3
    assert len(np.unique(body.position, axis=0)) == len(body.position) > 500
    np.testing.assert_allclose(offset.mean(0)[[0, 2]], 0.0, atol=1e-9)
    mirrored = offset * [1.0, 1.0, -1.0] if shape != "twisted_bar" else offset * [-1.0, 1.0, -1.0]
    assert {*map(tuple, mirrored.round(6))} == {*map(tuple, offset.round(6))}


def test_holes_are_empty_and_spikes_stand_out() -> None:
    for shape in ("torus", "hollow_box"):
        hole = np.linalg.norm(particles(shape, particles_per_edge=20).position - 0.5, axis=1)
        assert hole.min() > 0.09, shape
    spikes = np.linalg.norm(particles("spiky_sphere", side=1.0, particles_per_edge=40).position - 0.5, axis=1)
    assert 0.0 < (spikes > 0.4).mean() < 0.03, "twelve thin tips"


def test_spin_is_a_rigid_rotation_about_the_centre() -> None:
    cube = particles(particles_per_edge=3)
    velocity = spin_velocity(cube.position, cube.velocity + np.array((1.0, 0.0, 0.0)), (0, 0, 2))
    np.testing.assert_allclose(velocity.mean(0), [1.0, 0.0, 0.0], atol=1e-14)
    corner = int(np.flatnonzero((cube.position == [0.75, 0.5, 0.5]).all(1))[0])
    np.testing.assert_allclose(velocity[corner], [1.0, 0.5, 0.0], atol=1e-14)


@pytest.mark.parametrize(
    "options",
    [
        {"shape": "cub"},
        {"side": 0.0},
        {"side": math.nan},
        {"centre": (0.5, 0.5)},
        {"centre": (0.5, math.inf, 0.5)},
        {"particles_per_edge": 1},
        {"particles_per_edge": 10**6},
        {"shape": "sphere", "particles_per_edge": 2},
        {"shape": "torus", "particles_per_edge": 7},
    ],
)
def test_nonsense_shapes_are_refused(options: dict[str, Any]) -> None:
    with pytest.raises(UserError, match=r"^scene\.\w+=.*accepted|too coarse"):
        particles(**options)


def _points(count: int = 4) -> dict[str, np.ndarray]:
    return {"position": np.full((count, 3), 0.5), "velocity": np.ones((count, 3)), "volume": np.full(count, 1e-4)}


def test_an_npz_of_points_is_read(tmp_path: Path) -> None:
    np.savez(tmp_path / "x.npz", allow_pickle=True, **_points())
    body = read_point_file(tmp_path / "x.npz")
    np.testing.assert_array_equal(body.velocity, np.ones((4, 3)))
    assert body.position.dtype == np.float64
    assert body.deformation is None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"position": np.zeros((4, 2))}, "'position' has the shape"),
        ({"position": np.zeros(())}, "'position' has the shape"),
        ({"velocity": np.zeros((3, 3))}, "'velocity' has the shape"),
        ({"volume": np.zeros((4, 1))}, "'volume' has the shape"),
        ({"volume": np.zeros(4)}, "'volume' is not positive"),
        ({"velocity": np.full((4, 3), np.nan)}, "'velocity' holds numbers that are not finite"),
        ({"position": np.full((4, 3), "a")}, "'position' holds"),
        ({"position": np.full((4, 3), None)}, "damaged"),
        (_points(0), "holds no particle"),
    ],
)
def test_wrong_points_are_one_line(change: dict[str, np.ndarray], message: str, tmp_path: Path) -> None:
    path = tmp_path / "x.npz"
    np.savez(path, allow_pickle=True, **{**_points(), **change})
    with pytest.raises(UserError, match=message) as raised:
        read_point_file(path)
    assert str(path) in str(raised.value)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("name", "make", "message"),
    [
        ("x.npz", lambda path: None, "no such file"),
        ("x.csv", lambda path: path.touch(), "accepted: a file ending in"),
        ("x.npz", lambda path: path.touch(), "not an .npz file"),
        ("x.npz", lambda path: path.write_bytes(b"PK\x03\x04 and no more"), "not an .npz file"),
        ("x.npz", lambda path: np.savez(path, position=np.zeros((2, 3))), "'velocity' is missing"),
        ("x.h5", lambda path: path.touch(), "the file is empty"),
        ("x.h5", lambda path: written(path, recording("a"), recording("b")), "holds 2 scenes"),
        ("x.h5", hand_written, "no initial_velocity"),
    ],
)
def test_wrong_point_files_are_one_line(
    name: str, make: Callable[[Path], object], message: str, tmp_path: Path
) -> None:
    make(tmp_path / name)
    with pytest.raises(UserError, match=message) as raised:
        read_point_file(tmp_path / name)
    assert name in str(raised.value)
    assert "\n" not in str(raised.value)


def test_a_trajectory_file_gives_its_first_frame(tmp_path: Path) -> None:
    path = written(tmp_path / "x.h5", recording("a"), recording("b", keyframes=False))
    record = recording("a")
    body = read_point_file(path, "a")
    np.testing.assert_array_equal(body.position, record.position[0])
    assert record.keyframes is not None
    np.testing.assert_array_equal(body.deformation, record.keyframes.deformation[0])
    assert read_point_file(path, "b").affine is None
