"""Files of unlabelled points: what is read, and what is refused in one line."""

from pathlib import Path

import numpy as np
import pytest

from pcnclaws.data.point_frames import PointFrames, read_point_frames, write_point_frames
from pcnclaws.data.point_observation import from_points
from pcnclaws.errors import UserError
from pcnclaws.geometry.shapes import particles
from pcnclaws.mpm.settings import SimulationSettings

BODY = particles("cube", side=0.2, particles_per_edge=4)


@pytest.fixture
def frames() -> PointFrames:
    """Points on a cube, 7 to 9 a frame."""
    chance = np.random.default_rng(0)
    counts = [8, 7, 9]
    place = 0.4 + 0.2 * chance.random((sum(counts), 3))
    place[:, 0] = 0.6
    return PointFrames(np.array([0.0, 0.01, 0.025]), place, np.repeat(np.arange(3), counts))


def observed(path: Path, **options):
    return from_points(path, "sand", SimulationSettings(), BODY, velocity_known=True, **options)


@pytest.mark.parametrize("name", ["p.csv", "p.npz", "p.ply"])
def test_each_format_gives_the_points_back(frames: PointFrames, name: str, tmp_path: Path) -> None:
    files = write_point_frames(tmp_path / name, frames)
    assert len(files) == (3 if name == "p.ply" else 1)
    again = read_point_frames(tmp_path / ("p_*.ply" if name == "p.ply" else name))
    np.testing.assert_allclose(again.time, frames.time, atol=1e-9)
    np.testing.assert_array_equal(again.frame, frames.frame)
    np.testing.assert_allclose(again.position, frames.position, atol=1e-7)


def test_arrays_may_be_padded_or_bear_a_time_for_each_point(frames: PointFrames, tmp_path: Path) -> None:
    np.savez(tmp_path / "padded.npz", time=frames.time, position=frames.by_frame())
    np.savez(tmp_path / "points.npz", time=frames.time[frames.frame], position=frames.position)
    for name in ("padded.npz", "points.npz"):
        again = read_point_frames(tmp_path / name)
        np.testing.assert_array_equal(again.frame, frames.frame)
        np.testing.assert_array_equal(again.position, frames.position)


def test_units_and_the_start_are_brought_to_those_of_the_simulation(frames: PointFrames, tmp_path: Path) -> None:
    later = frames._replace(time=frames.time + 1.5, position=1e3 * frames.position)
    write_point_frames(tmp_path / "p.csv", later)
    observation = observed(tmp_path / "p.csv", units="mm", start=1.51)
    np.testing.assert_allclose(observation.time, [0.0, 0.015], atol=1e-6)
    assert observation.points is not None
    np.testing.assert_allclose(observation.points.position, frames.position[frames.frame > 0], atol=1e-6)
    assert observation.between(0.01, 1.0).positions == 9


def changed(frames: PointFrames, how: str) -> PointFrames:
    place, time, frame = frames.position.copy(), frames.time.copy(), frames.frame
    match how:
        case "nan":
            place[3, 1] = np.nan
        case "backwards":
            time[2] = 0.005
        case "millimetres":
            place *= 1e3
        case "feet":
            place /= 0.3048
        case "stray":
            place[2] = [0.9, 0.9, 0.9]
        case "later stray":
            place[12] = [0.5, 1.4, 0.5]
        case "few":
            place, frame = place[:18], frame[:18]
        case "empty":
            place, frame = place[:15], frame[:15]
        case "late":
            time = time - 1.0
    return PointFrames(time, place, frame)


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ("nan", "is not finite; accepted: finite numbers"),
        ("backwards", "the time 0.005 s comes after 0.01 s; accepted: times that increase"),
        ("millimetres", "far beyond the domain of 1 m; metres expected"),
        ("feet", "far beyond the domain of 1 m; metres expected"),
        (
            "stray",
            "point (0.9, 0.9, 0.9) m at 0 s is 0.52 m from the nearest particle, 1 of 8 are; accepted: points on",
        ),
        ("later stray", "point (0.5, 1.4, 0.5) m at 0.01 s is 0.9"),
        ("few", "the frame at 0.025 s holds 3 points; accepted: at least 6 in every frame"),
        ("empty", "the frame at 0.025 s holds no points; accepted: at least 6 in every frame"),
        ("late", "its times end at -0.975 s; accepted: frames after the start"),
    ],
)
def test_wrong_points_are_refused_in_one_line(how: str, message: str, frames: PointFrames, tmp_path: Path) -> None:
    write_point_frames(tmp_path / "p.npz", changed(frames, how))
    with pytest.raises(UserError) as refused:
        observed(tmp_path / "p.npz")
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time,x,y\n0,1,1\n", "the column 'z' is missing; accepted: the header time,x,y,z"),
        ("time,x,y,z\n0,0.5,,0.5\n", "line 2 holds '0,0.5,,0.5'; accepted: four finite numbers"),
        ("time,x,y,z\n0,0.5,nan,0.5\n", "line 2 holds"),
        ("time,x,y,z\n0,0.5,a,0.5\n", "line 2 holds"),
        ("time,x,y,z\n", "holds no point"),
        ("time,x,y,z\n0.2,.5,.5,.5\n0.1,.5,.5,.5\n", "the time 0.1 s comes after 0.2 s"),
    ],
)
def test_wrong_tables_are_refused_in_one_line(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "p.csv").write_text(text)
    with pytest.raises(UserError, match=r"p\.csv") as refused:
        read_point_frames(tmp_path / "p.csv")
    assert message in str(refused.value)


def test_wrong_arrays_are_refused_in_one_line(frames: PointFrames, tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", time=frames.time, position=frames.position)
    np.savez(tmp_path / "b.npz", position=frames.position)
    np.savez(tmp_path / "c.npz", time=frames.time, position=frames.position, frame=frames.frame + 1)
    for name, message in (("a", "holds arrays of the shapes"), ("b", "'time' is missing"), ("c", "goes from 1 to 3")):
        with pytest.raises(UserError, match=message):
            read_point_frames(tmp_path / f"{name}.npz")
    with pytest.raises(UserError, match="accepted: points in .csv, .npz, .ply"):
        read_point_frames(tmp_path / "a.xyz")
