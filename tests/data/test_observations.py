"""Observations as files: markers on bodies, tables of them, and what is refused."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from recorded_scenes import recorded, small_cube

from pcnclaws.data.hdf5 import write_scenes
from pcnclaws.data.markers import followed_particles
from pcnclaws.data.observation_files import from_record, from_table, observed_record
from pcnclaws.errors import UserError
from pcnclaws.geometry.shapes import particles
from pcnclaws.mpm.settings import SimulationSettings

BODY = particles("cube", side=0.3, particles_per_edge=6)


def table(path: Path, *lines: str, header: str = "time,marker,x,y,z") -> Path:
    path.write_text("\n".join((header, *lines)) + "\n", encoding="utf-8")
    return path


def read(path: Path):
    return from_table(path, "sand", SimulationSettings(), BODY, velocity_known=False)


def test_markers_follow_every_affine_motion_exactly() -> None:
    generator = np.random.default_rng(0)
    marker = 0.5 + 0.3 * (generator.random((20, 3)) - 0.5)
    marker[0] = BODY.position[7]
    particle, weight = followed_particles(marker, [""] * 20, BODY.position, 0.05)
    gradient, shift = generator.standard_normal((3, 3)), generator.standard_normal(3)
    moved = BODY.position @ gradient.T + shift
    followed = np.einsum("mk,mkc->mc", weight, moved[particle])
    np.testing.assert_allclose(followed, marker @ gradient.T + shift, atol=1e-9)
    np.testing.assert_allclose(weight.sum(1), 1.0)
    np.testing.assert_allclose(weight[0].max(), 1.0, atol=1e-6)


def test_a_marker_that_stands_off_a_face_follows_it_as_a_piece() -> None:
    generator = np.random.default_rng(0)
    marker = np.array([[0.52, 0.5, 0.68], [0.52, 0.53, 0.5]])
    particle, weight = followed_particles(marker, ["off", "in"], BODY.position, 0.05)
    moved = BODY.position @ (gradient := generator.standard_normal((3, 3))).T
    np.testing.assert_allclose(np.einsum("mk,mkc->mc", weight, moved[particle]), marker @ gradient.T, atol=1e-9)


def test_a_marker_far_from_the_body_is_named() -> None:
    with pytest.raises(UserError, match="marker 'hand' is 0.0751 m from the body; accepted: at most"):
        followed_particles(np.array([[0.5, 0.712, 0.5]]), ["hand"], BODY.position, 0.05)


def test_a_table_of_markers_may_have_gaps(tmp_path: Path) -> None:
    path = table(
        tmp_path / "dough.csv", "0,a,.4,.5,.5", "0,b,.6,.5,.5", "0.01,a,.41,.5,.5", "0.02,b,.61,.5,.5", "0.02,a,,,"
    )
    seen = read(path)
    np.testing.assert_array_equal(seen.time, [0.0, 0.01, 0.02])
    np.testing.assert_array_equal(seen.seen, [[True, True], [True, False], [False, True]])
    np.testing.assert_allclose(seen.target[2, 1], [0.61, 0.5, 0.5])
    assert (seen.name, seen.initial_velocity, len(seen.position)) == ("dough", None, 216)


def test_a_marker_that_is_not_seen_at_the_start_has_no_place_and_is_left_out(tmp_path: Path) -> None:
    seen = read(table(tmp_path / "x.csv", "0,a,.4,.5,.5", "0.01,a,.4,.5,.5", "0.01,b,.6,.5,.5"))
    assert seen.target.shape == (2, 1, 3)


@pytest.mark.parametrize(
    ("lines", "header", "message"),
    [
        (["0,a,.4,.5,.5"], "t,marker,x,y,z", "column 'time' is missing"),
        ([], "time,marker,x,y,z", "holds no marker"),
        (["0,a,.4,five,.5"], "time,marker,x,y,z", "line 2: y='five' is not a number"),
        ([",a,.4,.5,.5"], "time,marker,x,y,z", "line 2 has no time"),
        (["0,a,400,500,500"], "time,marker,x,y,z", "metres expected"),
        (["0,a,,,"], "time,marker,x,y,z", "all are NaN"),
        (["0.1,a,.4,.5,.5"], "time,marker,x,y,z", "first frame is at 0.1 s"),
    ],
)
def test_a_wrong_table_is_refused_in_one_line(lines: list[str], header: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(UserError, match=message):
        read(table(tmp_path / "x.csv", *lines, header=header))


def test_a_recorded_scene_is_an_observation_of_its_particles(tmp_path: Path) -> None:
    record = recorded(small_cube("a"))[0]
    hidden = record.position.copy()
    hidden[2:, :40] = np.nan
    write_scenes(tmp_path / "x.h5", [replace(record, position=hidden)])
    seen = from_record(observed_record(tmp_path / "x.h5", None, "sand"))
    assert seen.seen.sum() == 64 * 2 + 24 * 5
    np.testing.assert_array_equal(np.einsum("mk,mkc->mc", seen.weight, seen.position[seen.particle]), seen.target[0])
    assert seen.between(0.005, 0.01).time.tolist() == pytest.approx([0.005, 0.0075, 0.01])
    with pytest.raises(UserError, match=r"observation.window=\[1, 2\] holds no observed position"):
        seen.between(1.0, 2.0)


def test_another_material_and_an_unnamed_scene_of_several_are_refused(tmp_path: Path) -> None:
    record = recorded(small_cube("a"))[0]
    write_scenes(tmp_path / "x.h5", [record, replace(record, name="b")])
    with pytest.raises(UserError, match="observation.scene= one of a, b"):
        observed_record(tmp_path / "x.h5", None, "sand")
    with pytest.raises(UserError, match="observed of material 'sand'; accepted: plasticine"):
        observed_record(tmp_path / "x.h5", "a", "plasticine")
