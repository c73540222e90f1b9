"""What markers show of a recorded motion."""

from pathlib import Path

import numpy as np
import pytest
from recorded_scenes import small_cube

from pcnclaws.data.hdf5 import write_scenes
from pcnclaws.data.markers import surface_particles
from pcnclaws.data.observation_files import from_table
from pcnclaws.data.point_frames import read_point_frames
from pcnclaws.geometry.shapes import PointCloud, particles
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.observe import observe
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.records import SceneRecord


@pytest.fixture(scope="module")
def record() -> SceneRecord:
    start = small_cube("elasticity", "elasticity", (0.5, -2.0, 0.0))
    return simulate_records([start], analytic_laws(MATERIALS["elasticity"]), FramePlan(40, 2))[0]


@pytest.fixture
def observed(in_process, record, tmp_path: Path):
    write_scenes(tmp_path / "x.h5", [record])

    def run(*arguments: str):
        return in_process(observe, "observe", "file=x.h5", "output=m.csv", *arguments)

    return run


@pytest.mark.parametrize("edge", [4, 7])
def test_the_surface_of_a_cube_is_all_but_its_inside(edge: int) -> None:
    body = particles("cube", side=0.3, particles_per_edge=edge)
    surface = surface_particles(body.position)
    inside = np.abs(body.position - 0.5).max(1) < 0.15 - 1e-6
    np.testing.assert_array_equal(surface, ~inside)


def test_without_noise_the_table_is_the_motion_of_the_particles(observed, record, tmp_path: Path) -> None:
    outcome = observed("every=5", "markers=0.25")
    assert outcome.status == 0, outcome.err
    body = PointCloud(record.position[0].astype(float), record.initial_velocity, record.volume.astype(float))
    seen = from_table(tmp_path / "m.csv", "elasticity", record.settings, body, velocity_known=False)
    assert seen.target.shape == (5, 16, 3)
    np.testing.assert_allclose(seen.time, record.time[::5], atol=1e-9)
    chosen = seen.particle[np.arange(16), seen.weight.argmax(1)]
    np.testing.assert_allclose(seen.target, record.position[::5][:, chosen], atol=1e-6)
    assert (tmp_path / "m.png").exists()


def test_noise_and_gaps_are_as_asked_for_and_the_first_frame_is_whole(observed, record, tmp_path: Path) -> None:
    assert observed("noise=1e-3", "missing=0.3", "seed=4").status == 0
    body = PointCloud(record.position[0].astype(float), record.initial_velocity, record.volume.astype(float))
    seen = from_table(tmp_path / "m.csv", "elasticity", record.settings, body, velocity_known=False)
    assert seen.seen[0].all()
    assert seen.seen[1:].mean() == pytest.approx(0.7, abs=0.05)
    error = seen.target - record.position
    assert np.nanstd(error) == pytest.approx(1e-3, rel=0.1)
    assert abs(np.nanmean(error)) < 1e-4


@pytest.mark.parametrize(
    ("argument", "message"),
    [
        ("file=null", "file=null is not accepted; accepted: the path of a trajectory file"),
        ("file=y.h5", "y.h5: no such file"),
        ("markers=0", "markers=0 is 0 markers; accepted: 1 to 64, the number of particles"),
        ("noise=-1", "noise=-1 is not accepted; accepted: a number from 0 to 1"),
        ("missing=2", "missing=2 is not accepted; accepted: a number from 0 to 1"),
        ("output=x.h5", "output=x.h5 is the file of file, which would be lost"),
    ],
)
def test_wrong_input_is_one_line(argument: str, message: str, observed, tmp_path: Path) -> None:
    outcome = observed(argument)
    assert outcome.status == 2
    assert message in outcome.err
    assert not (tmp_path / "m.csv").exists()


def test_more_markers_than_the_surface_has_are_refused(observed) -> None:
    assert "accepted: 1 to 56, the number of surface particles" in observed("surface=true").err


@pytest.mark.parametrize("output", ["p.npz", "p.csv", "p.ply"])
def test_points_are_on_the_side_of_the_camera_and_differ_in_number(output: str, observed, record, tmp_path) -> None:
    outcome = observed("kind=points", "points=60", "camera=[0,1,0]", "every=5", "missing=0.2", f"output={output}")
    assert outcome.status == 0, outcome.err
    seen = read_point_frames(tmp_path / ("p_*.ply" if output == "p.ply" else output))
    counts = np.bincount(seen.frame)
    assert len(set(counts.tolist())) > 1
    assert counts.mean() == pytest.approx(48, abs=12)
    np.testing.assert_allclose(seen.time, record.time[::5] - record.time[0], atol=1e-8)
    first = seen.position[seen.frame == 0]
    np.testing.assert_allclose(first[:, 1], record.position[0, :, 1].max(), atol=1e-6)
    assert (tmp_path / "p.png").exists()


@pytest.mark.parametrize(
    ("argument", "message"),
    [
        ("kind=point", "kind='point' is not known; accepted: markers, points"),
        (
            "camera=[0,0,0]",
            "camera=[0, 0, 0] is not accepted; accepted: [x, y, z] from the body to the camera, or null",
        ),
        ("points=0", "points=0 is not accepted"),
        ("surface=true", "with kind=points, which are on the surface"),
    ],
)
def test_wrong_points_are_refused_in_one_line(argument: str, message: str, observed) -> None:
    outcome = observed("kind=points", "output=p.npz", argument)
    assert outcome.status == 2
    assert message in outcome.err
