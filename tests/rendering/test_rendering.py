"""Pictures: what they show, and that they are written whole."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from recorded_scenes import moved, recorded, small_cube

from pcnclaws.errors import UserError
from pcnclaws.mpm.colliders import Collider
from pcnclaws.rendering.animation import animation
from pcnclaws.rendering.camera import Camera
from pcnclaws.rendering.comparison_sheet import Pair, comparison_sheet
from pcnclaws.rendering.curves import ErrorCurve, LossCurve, error_over_time, loss_curve
from pcnclaws.rendering.labels import material_label
from pcnclaws.rendering.panels import camera_for, panel
from pcnclaws.rendering.pictures import predicted_beside_true, trajectory_picture
from pcnclaws.rendering.spheres import draw_particles
from pcnclaws.rendering.upright import upright
from pcnclaws.simulation.records import SceneRecord

CAMERA = Camera(0.1, 0.9, 0.8, 120)
RED, BLUE = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)


@pytest.fixture(scope="module")
def record() -> SceneRecord:
    return replace(recorded(small_cube("fall"))[0], velocity=None, keyframes=None)


def draw(*spheres: tuple[tuple[float, float, float], tuple[float, float, float]]) -> np.ndarray:
    position, colour = (np.array(values) for values in zip(*spheres, strict=True))
    return draw_particles(CAMERA, position, np.full(len(position), 0.04), colour)


def area(picture: np.ndarray, channel: int) -> int:
    """Number of pixels in which a colour channel stands out."""
    values = picture.astype(int)
    return int((values[..., channel] > np.delete(values, channel, axis=2).max(2) + 60).sum())


def size_of(path: Path) -> tuple[int, int]:
    """Width and height of a picture file [pixels]."""
    with Image.open(path) as picture:
        return picture.size


def test_the_whole_box_is_in_the_picture() -> None:
    column, row, depth = CAMERA.project(CAMERA.corners)
    assert column.min() > 0
    assert column.max() < CAMERA.width
    assert row.min() > 0
    assert row.max() < CAMERA.height
    assert depth.min() > 0


def test_up_is_up_and_right_is_right_and_distances_are_the_same_in_all_directions() -> None:
    centre = np.array([0.5, 0.45, 0.5])
    right, up, _ = CAMERA.axes
    column, row, _ = CAMERA.project(centre + 0.01 * np.stack((0 * up, up, right)))
    assert row[1] < row[0]
    assert column[2] > column[0]
    assert row[0] - row[1] == pytest.approx(column[2] - column[0], rel=1e-3)


def test_a_particle_hides_what_is_behind_it() -> None:
    front = np.array([0.5, 0.45, 0.5])
    behind = front - 0.1 * (CAMERA.eye - front) / np.linalg.norm(CAMERA.eye - front)
    for picture in (draw((tuple(front), RED), (tuple(behind), BLUE)), draw((tuple(behind), BLUE), (tuple(front), RED))):
        assert area(picture, 0) > 50
        assert area(picture, 2) == 0


def test_spheres_are_round_and_as_large_as_they_are() -> None:
    position = np.array([0.5, 0.45, 0.5])
    radius = 0.04 * CAMERA.pixels_per_unit / float(CAMERA.project(position[None])[2][0])
    assert area(draw((tuple(position), RED)), 0) == pytest.approx(np.pi * radius**2, rel=0.1)


def test_unobserved_particles_are_not_drawn(record: SceneRecord) -> None:
    camera = camera_for([record], 100)
    position = record.position.copy()
    position[:, 10:] = np.nan
    shown = panel(replace(record, position=position), 3, camera)
    alone = replace(record, position=record.position[:, :10], volume=record.volume[:10], initial_velocity=None)
    np.testing.assert_array_equal(shown, panel(alone, 3, camera))
    nobody = replace(record, position=np.full_like(record.position, np.nan))
    assert panel(nobody, 3, camera).shape == shown.shape


def test_a_particle_throws_a_shadow_on_the_floor() -> None:
    floor_below = draw(((0.5, 0.2, 0.5), RED)).astype(int) - draw(((0.5, 0.2, 5.0), RED))
    assert (floor_below < -10).sum() > 50


def test_trajectory_picture_and_sheet_show_five_times(record: SceneRecord, tmp_path: Path) -> None:
    width, height = size_of(trajectory_picture(record, tmp_path / "new" / "a.png"))
    assert width > 5 * 250
    assert size_of(predicted_beside_true(record, moved(record, 0.01), tmp_path / "b.png"))[1] > 1.5 * height
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["a.png", "b.png", "new"]


def test_equal_trajectories_and_single_frames_make_pictures_too(record: SceneRecord, tmp_path: Path) -> None:
    assert predicted_beside_true(record, record, tmp_path / "same.png").stat().st_size > 0
    first = replace(record, time=record.time[:1], position=record.position[:1])
    assert trajectory_picture(first, tmp_path / "one.png").stat().st_size > 0


def test_the_comparison_sheet_colours_what_is_far_off_and_stays_small(record: SceneRecord, tmp_path: Path) -> None:
    pairs = [Pair(record, record), Pair(record, moved(record, 0.02))]
    path = comparison_sheet(pairs, tmp_path / "s.png", "sand")
    with Image.open(path) as picture:
        pixels = np.asarray(picture.convert("RGB")).astype(int)
    assert pixels.shape[1] == 1600
    assert path.stat().st_size < 500_000
    purple = pixels[..., 2] > pixels[..., 1] + 40
    top, middle = 40, len(pixels) // 2
    assert purple[top:middle].sum() == 0
    assert purple[middle:-50].sum() > 1000
    assert comparison_sheet(pairs[:1], tmp_path / "one.png", "").stat().st_size > 0


def test_animation_is_small_lasts_as_asked_and_loops(record: SceneRecord, tmp_path: Path) -> None:
    path = animation(record, moved(record, 0.01), tmp_path / "a.gif", seconds=2.0, pictures=8)
    with Image.open(path) as film:
        assert getattr(film, "n_frames", 1) == 7
        assert film.info["loop"] == 0
        assert film.info["duration"] == pytest.approx(2000 / 7, abs=10)
    assert path.stat().st_size < 200_000
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.gif"]


def test_curves_leave_out_what_a_logarithmic_axis_cannot_show(tmp_path: Path) -> None:
    time = np.linspace(0.0, 0.1, 5)
    good = ErrorCurve("a", time, np.array([0.0, 1e-8, 1e-6, np.nan, 1e-5]))
    zero = ErrorCurve("b", time, np.zeros(5))
    assert error_over_time([good, zero], tmp_path / "e.png", before=[good]).stat().st_size > 0
    assert error_over_time([zero], tmp_path / "z.png").stat().st_size > 0
    checks = LossCurve([0, 10, 20], [1e-3, float("inf"), 1e-5])
    assert loss_curve(LossCurve(range(20), [1e-4] * 20), tmp_path / "l.png", checks).stat().st_size > 0
    assert loss_curve(LossCurve([0], [1e-4]), tmp_path / "m.png").stat().st_size > 0


def test_an_unwritable_place_is_one_clear_line(record: SceneRecord, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match=r"cannot be written"):
        trajectory_picture(record, tmp_path / "file" / "a.png")


def test_labels_name_the_parameters_with_units() -> None:
    plasticine = {"youngs_modulus": 5.3e5, "poissons_ratio": 0.31, "yield_stress": 5.1e3}
    assert material_label("plasticine", plasticine) == (
        "plasticine, E 530 kPa, \N{GREEK SMALL LETTER NU} 0.31, τ_Y 5.1 kPa"
    )


DOWN = [(0.0, -9.8, 0.0), (0.0, 9.8, 0.0), (0.0, 0.0, -9.8), (0.0, 0.0, 9.8), (-9.8, 0.0, 0.0), (1.0, -2.0, -9.0)]


@pytest.mark.parametrize("gravity", DOWN)
def test_the_wall_that_gravity_points_to_is_the_floor(gravity: tuple[float, float, float], record: SceneRecord) -> None:
    axis = int(np.abs(gravity).argmax())
    corners = np.array([[0.5, 0.5, 0.5], *(0.5 + 0.4 * np.eye(3))])
    turned = upright(corners, gravity)
    edges = turned[1:] - turned[0]
    assert np.linalg.det(edges / 0.4) == pytest.approx(1.0), "turned, not mirrored"
    floor = np.full(3, 0.5)
    floor[axis] = 0.1 if gravity[axis] < 0.0 else 0.9
    np.testing.assert_allclose(upright(floor, gravity), (0.5, 0.1, 0.5))
    # the scene of a world that is turned looks the same
    frame = record.position[3].astype(np.float64)
    back = 0.5 + (frame - 0.5) @ (edges / 0.4).T
    there = replace(
        record, settings=replace(record.settings, gravity=gravity), position=np.stack([back] * len(record.time))
    )
    camera = camera_for([record], 100)
    difference = panel(there, 3, camera).astype(int) - panel(record, 3, camera)
    assert (np.abs(difference).max(2) > 2).mean() < 0.01
    here = replace(record, position=np.stack([frame] * len(record.time)))
    assert camera_for([there], 100).top == pytest.approx(camera_for([here], 100).top)


def test_there_is_no_floor_without_gravity(record: SceneRecord) -> None:
    camera = camera_for([record], 100)
    weightless = replace(record, settings=replace(record.settings, gravity=(0.0, 0.0, 0.0)))
    for frame in (0, 3):
        pictures = [panel(one, frame, camera).astype(int) for one in (record, weightless)]
        body = np.ptp(pictures[0], axis=2) > 10
        assert np.abs(pictures[1] - pictures[0])[body].mean() < 3.0
        assert (pictures[1] - pictures[0])[~body].max() > 30, "its shadow is gone"
    assert camera_for([weightless], 100).top == 0.9


def test_colliders_are_shown_where_they_are_in_that_frame_and_behind_what_is_nearer(record):
    """A sphere that rises behind the body hides none of it, one before it all."""
    near, far = (0.5, 0.2, 0.85), (0.5, 0.2, 0.15)
    body = np.broadcast_to(0.5 + 0.02 * record.position[0], record.position.shape)
    alone = replace(record, position=body)
    camera = camera_for([alone], 100)
    plain = panel(alone, 0, camera).astype(int)
    changed = {}
    for word, collider in (
        ("behind", Collider.sphere(far, 0.1)),
        ("before", Collider.sphere(near, 0.1)),
        ("moving", Collider.sphere(near, 0.1, velocity=(-0.2 / float(record.time[-1] - record.time[0]), 0.0, 0.0))),
        ("gone", Collider.sphere(near, 0.1, start=100.0)),
    ):
        there = replace(alone, settings=replace(record.settings, colliders=(collider,)))
        for frame in (0, len(record.time) - 1):
            difference = np.abs(panel(there, frame, camera).astype(int) - plain).sum(2)
            changed[word, frame] = difference.nonzero()[1]
    last = len(record.time) - 1
    assert len(changed["behind", 0]) > 50
    assert len(changed["before", 0]) > len(changed["behind", 0])  # it is nearer
    np.testing.assert_array_equal(changed["before", 0], changed["before", last])
    np.testing.assert_array_equal(changed["moving", 0], changed["before", 0])
    assert changed["moving", last].mean() < changed["before", 0].mean() - 10
    assert not len(changed["gone", 0])


def test_a_picture_reaches_as_high_as_a_collider(record):
    stamp = Collider.box((0.4, 0.7, 0.4), (0.6, 0.8, 0.6))
    there = replace(record, settings=replace(record.settings, colliders=(stamp,)))
    assert camera_for([record], 100).top < 0.7
    assert camera_for([there], 100).top == pytest.approx(0.84, abs=0.04)
