"""The command `simulate`: what it writes, what it leaves, what it refuses."""

import os
from pathlib import Path

import numpy as np
import pytest

from pcnclaws.commands.composition import compose_config
from pcnclaws.data.hdf5 import read_scenes
from pcnclaws.errors import UserError
from pcnclaws.simulate import simulate

SHORT = ("simulation.steps=10", "law=analytic")
SMALL = (*SHORT, "scene.particles_per_edge=4")


def files(folder) -> list[str]:
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def test_it_writes_the_trajectory_and_a_picture_and_no_more(in_process, tmp_path):
    outcome = in_process(simulate, "simulate", *SMALL, "output=deep/er/x.h5", "parameters.friction_angle=30")
    assert outcome.status == 0
    assert files(tmp_path) == ["deep/er/x.h5", "deep/er/x.png"]
    assert "wrote deep/er/x.h5" in outcome.out
    assert "wrote deep/er/x.png" in outcome.out
    (record,) = read_scenes(tmp_path / "deep/er/x.h5")
    assert record.material == "sand"
    assert record.parameters["friction_angle"] == 30.0
    assert record.position.shape == (3, 64, 3)
    assert record.time == pytest.approx([0.0, 25e-4, 50e-4])


@pytest.mark.parametrize("material", ["elasticity", "plasticine", "sand"])
def test_free_fall_is_exact_for_every_material(material, in_process, tmp_path):
    in_process(
        simulate,
        "simulate",
        *SMALL,
        f"material={material}",
        "scene.velocity=[1,0,0]",
        "output=x.h5",
        "picture=false",
        "precision=float64",
    )
    (record,) = read_scenes(tmp_path / "x.h5")
    n, dt = 10, 5e-4
    moved = record.position[-1] - record.position[0]
    expected = [n * dt, -9.8 * dt**2 * n * (n + 1) / 2, 0.0]
    np.testing.assert_allclose(moved, np.broadcast_to(expected, moved.shape), atol=1e-7)


def test_a_scene_goes_on_from_a_file_with_a_motion_added(in_process, tmp_path):
    in_process(simulate, "simulate", *SMALL, "output=x.h5", "picture=false", "scene.velocity=[1,0,0]")
    outcome = in_process(
        simulate, "simulate", *SHORT, "output=y.h5", "picture=false", "scene.particles=x.h5", "scene.velocity=[0,0,2]"
    )
    assert outcome.status == 0
    first, second = read_scenes(tmp_path / "x.h5")[0], read_scenes(tmp_path / "y.h5")[0]
    np.testing.assert_array_equal(second.position[0], first.position[0])
    assert second.initial_velocity is not None
    np.testing.assert_allclose(second.initial_velocity, np.broadcast_to([1.0, 0.0, 2.0], (64, 3)))


def test_a_spin_is_about_the_centre(in_process, tmp_path):
    in_process(simulate, "simulate", *SMALL, "output=x.h5", "picture=false", "scene.spin=[0,0,4]")
    (record,) = read_scenes(tmp_path / "x.h5")
    x, y, _ = (record.position[0] - 0.5).T
    assert record.initial_velocity is not None
    np.testing.assert_allclose(record.initial_velocity, np.stack((-4 * y, 4 * x, 0 * x), 1), atol=1e-6)


def test_keyframes_are_kept_on_request(in_process, tmp_path):
    in_process(simulate, "simulate", *SMALL, "output=x.h5", "picture=false", "keyframe_every=5")
    (record,) = read_scenes(tmp_path / "x.h5")
    assert record.keyframes is not None
    assert record.keyframes.step.tolist() == [0, 5, 10]


def test_a_time_step_above_0_4_warns_and_above_the_boundary_is_refused(in_process, tmp_path, caplog):
    assert in_process(simulate, "simulate", *SMALL, "output=x.h5", "simulation.time_step=1e-3").status == 0
    assert "simulation.time_step=auto stays at 0.4" in caplog.text
    outcome = in_process(simulate, "simulate", *SMALL, "output=y.h5", "simulation.time_step=3e-3")
    assert outcome.status == 2
    assert "simulation.time_step=0.003 is unstable; accepted: at most 0.00222" in outcome.err
    assert not (tmp_path / "y.h5").exists()


def test_a_diverged_simulation_exits_1_and_leaves_no_file(in_process, tmp_path):
    # a soft body that hits the wall so fast that it turns inside out
    arguments = ["material=elasticity", "parameters.youngs_modulus=5e4", "scene.velocity=[0,-60,0]"]
    outcome = in_process(simulate, "simulate", "law=analytic", "output=x.h5", "simulation.steps=60", *arguments)
    assert outcome.status == 1
    line = outcome.err.splitlines()[-1]
    assert all(word in line for word in ("scene 'cube'", "step", "particle", "at most"))
    assert files(tmp_path) == []


WRONG = {
    "parameters.poissons_ratio=0.5": "above -1 and below 0.5",
    "parameters.youngs_modulus=-1": "above 0",
    "parameters.friction_angle=90": "at least 0 and below 90",
    "simulation.steps=-1": "a whole number from 1",
    "simulation.every=0": "a whole number from 1",
    "simulation.grid_nodes=2": "from 4",
    "simulation.time_step=0": "positive",
    "simulation.boundary=stick": "did you mean 'sticky'",
    "simulation.wall_distance=0.6": "below 0.5",
    "simulation.wall_distance=0": "accepted: 0.05",
    "scene.shape=cubes": "did you mean 'cube'",
    "scene.centre=[0.5,0.3,0.5]": "wall layer",
    "scene.centre=[0.5,0.1,0.5]": "outside the domain",
    "scene.particles=missing.npz": "missing.npz",
    "law=analytical": "analytic",
    "output=.": "is a folder",
    "output=taken/x.h5": "not a folder",
    "device=tpu": "cpu, cuda",
    "precision=half": "float32, float64",
    "threads=0": "a whole number from 1",
}


@pytest.mark.parametrize("argument", list(WRONG))
def test_wrong_input_is_named_and_leaves_nothing(argument, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("taken").write_text("a file")
    default = [] if argument.startswith("output") else ["output=x.h5"]
    with pytest.raises(UserError) as caught:
        simulate(compose_config("simulate", [*default, argument]))
    line = str(caught.value)
    assert WRONG[argument] in line
    assert argument.partition("=")[0] in line
    assert files(tmp_path) == ["taken"]


def test_the_command_itself(command, tmp_path):
    assert command("simulate", *SMALL, "output=x.h5").status == 0
    assert files(tmp_path) == ["x.h5", "x.png"]
    outcome = command("simulate", "material=snad")
    assert outcome.status == 2
    (line,) = outcome.err.splitlines()
    assert "did you mean 'sand'" in line


def test_a_sweep_writes_one_trajectory_a_job(in_process, tmp_path):
    outcome = in_process(simulate, "simulate", *SMALL, "--multirun", "parameters.friction_angle=20,30", "picture=false")
    assert outcome.status == 0
    assert len(files(tmp_path)) == 2


def test_an_output_never_replaces_an_input_or_a_device(in_process, tmp_path):
    assert in_process(simulate, "simulate", *SMALL, "picture=false", "output=a.h5").status == 0
    before = (tmp_path / "a.h5").read_bytes()
    (tmp_path / "link.h5").symlink_to("target.h5")
    os.mkfifo(tmp_path / "pipe")
    for options, message in (
        (("scene.particles=a.h5", "output=./a.h5"), "output=a.h5 is the file of scene.particles"),
        (("output=pipe",), "output=pipe is not a regular file"),
        (("simulation.every=11", "output=b.h5"), "simulation.every=11 keeps no frame"),
    ):
        done = in_process(simulate, "simulate", *SHORT, "picture=false", *options)
        assert (done.status, len(done.err.splitlines())) == (2, 1), done.err
        assert message in done.err
    assert (tmp_path / "a.h5").read_bytes() == before
    assert in_process(simulate, "simulate", *SMALL, "picture=false", "output=link.h5").status == 0
    assert (tmp_path / "link.h5").is_symlink()
    assert (tmp_path / "target.h5").is_file()


def test_volumes_in_other_units_are_refused(in_process, tmp_path):
    position = np.full((5, 3), 0.5)
    np.savez(tmp_path / "cm.npz", position=position, velocity=np.zeros((5, 3)), volume=np.full(5, 125.0))
    done = in_process(simulate, "simulate", *SHORT, "picture=false", "scene.particles=cm.npz", "output=x.h5")
    assert done.status == 2
    assert "'volume' sums to 625, more than the domain holds" in done.err
    assert not (tmp_path / "x.h5").exists()
