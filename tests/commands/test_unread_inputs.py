"""What files hold beside what is read is named; contradictions and other units are noticed before a run begins."""

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from recorded_scenes import recorded, small_cube

from pcnclaws.calibrate import calibrate
from pcnclaws.commands.composition import compose_config
from pcnclaws.commands.configuration import start_from
from pcnclaws.commands.observation_setup import observation_from
from pcnclaws.data.first_motion import contradiction, name_contradictions
from pcnclaws.data.hdf5 import read_scenes, write_scenes
from pcnclaws.data.point_files import read_point_file
from pcnclaws.data.units import check_record
from pcnclaws.errors import UserError
from pcnclaws.estimate import estimate
from pcnclaws.evaluate import evaluate
from pcnclaws.generate import generate
from pcnclaws.laws.materials import material_named
from pcnclaws.observe import observe
from pcnclaws.simulate import simulate
from pcnclaws.simulation.batch import batch_scenes
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.simulation.scenes import SceneStart, start_of
from pcnclaws.simulation.time_step import Stability
from pcnclaws.train import train


def high(material: str = "elasticity", velocity: tuple[float, float, float] = (0.5, -2.0, 0.0)) -> SceneStart:
    """The small cube, far from all walls."""
    cube = small_cube("cube", material, velocity)
    return replace(cube, position=cube.position + np.array((0.0, 0.3, 0.0)))


@pytest.fixture(scope="module")
def falling() -> SceneRecord:
    return recorded(high("elasticity", (0.5, 0.0, 0.0)), steps=200, every=10, keyframe_every=0)[0]


def points(path: Path, **arrays: np.ndarray) -> Path:
    cube = high()
    fields = {"position": cube.position, "velocity": cube.velocity, "volume": cube.volume}
    np.savez(path, allow_pickle=False, **(fields | arrays))
    return path


def test_densities_of_particles_are_kept_and_count(tmp_path, in_process, caplog):
    density = np.linspace(500.0, 2000.0, 64)
    points(tmp_path / "p.npz", density=density, material=np.zeros(64, np.int32))
    options = ("material=elasticity", "scene.particles=p.npz", "picture=false")
    assert in_process(simulate, "simulate", *options, "simulation.steps=5", "output=x.h5").status == 0
    assert "p.npz: not read: material; read: position, velocity, volume, density" in caplog.messages
    start = start_of(read_scenes(tmp_path / "x.h5")[0])
    np.testing.assert_allclose(batch_scenes([start]).scenes.mass.numpy(), density * start.volume, rtol=1e-6)
    body = read_point_file(tmp_path / "x.h5")
    assert body.density is not None
    np.testing.assert_allclose(body.density, density, rtol=1e-6)

    # the fastest waves are those of the lightest particle
    auto = start_from(compose_config("simulate", [*options, "simulation.time_step=auto"]))
    light = replace(auto.settings, density=500.0)
    speed = float(np.hypot(0.5, np.sqrt(4.0 + 2.0 * 9.8 * 0.34)))
    assert Stability(light, auto.parameters, speed, "elasticity").cfl == pytest.approx(0.4, rel=0.02)
    done = in_process(simulate, "simulate", *options, "simulation.density=900", "output=y.h5")
    assert done.status == 2
    assert "simulation.density=900 has no effect on particles that bring their density" in done.err


def test_a_density_that_is_none_is_refused(tmp_path):
    with pytest.raises(UserError, match="'density' is not positive everywhere"):
        read_point_file(points(tmp_path / "p.npz", density=np.zeros(64)))
    with pytest.raises(UserError, match=r"'density' has the shape \(3,\); accepted: \(N,\)"):
        read_point_file(points(tmp_path / "p.npz", density=np.ones(3)))


def test_what_a_trajectory_file_holds_beside_is_named_once(tmp_path, caplog):
    one, other = (recorded(small_cube(name), steps=10)[0] for name in ("a", "b"))
    write_scenes(tmp_path / "x.h5", [one, other])
    read_scenes(tmp_path / "x.h5")
    read_scenes(tmp_path / "x.h5", ["a"], with_keyframes=False)
    assert not caplog.messages
    with h5py.File(tmp_path / "x.h5", "a") as file:
        file.attrs["author"] = "me"
        for name in ("a", "b"):
            file[f"scenes/{name}"].attrs["cohesion"] = 500.0
            file[f"scenes/{name}/temperature"] = np.ones(3)
            file[f"scenes/{name}/keyframes/internal"] = np.ones(3)
            file[f"scenes/{name}/position"].attrs["unit"] = "m"
    read_scenes(tmp_path / "x.h5")
    (line,) = caplog.messages
    assert line == (
        f"{tmp_path / 'x.h5'}: not read: @author, @cohesion, keyframes/internal, position/@unit, temperature"
    )


@pytest.mark.parametrize(
    ("task", "entry", "options", "accepted"),
    [
        (simulate, "simulate", ["output=out.vtu"], "a file that ends in .h5 or .hdf5"),
        (simulate, "simulate", ["output=out.npz"], "a file that ends in .h5 or .hdf5"),
        (evaluate, "evaluate", ["output=m.h5"], "a file that ends in .json"),
        (estimate, "estimate", ["output=e.csv"], "a file that ends in .json"),
        (observe, "observe", ["output=m.json"], "a file that ends in .csv"),
        (calibrate, "calibrate", ["output=c.yaml"], "a file that ends in .json"),
        (train, "train", ["output=run.h5"], "the path of a folder"),
        (generate, "generate", ["output=data.h5"], "the path of a folder"),
    ],
)
def test_an_ending_of_another_format_is_refused_before_any_work(task, entry, options, accepted, in_process, tmp_path):
    done = in_process(task, entry, *options)
    assert done.status == 2
    (line,) = done.err.splitlines()
    assert f"ends like a file of another format; accepted: {accepted}, or no ending" in line
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("output", ["x", "x_0.5", "x.H5", "x.hdf5", "run.final"])
def test_other_endings_are_part_of_a_name(output, in_process, tmp_path):
    options = ("simulation.steps=5", "scene.particles_per_edge=3", "picture=false", f"output={output}")
    assert in_process(simulate, "simulate", *options).status == 0
    assert (tmp_path / output).is_file()


@pytest.mark.parametrize("material", ["elasticity", "sand"])
@pytest.mark.parametrize("every", [1, 10])
def test_what_a_simulation_records_begins_as_it_says(material, every):
    flying, landing = high(material), small_cube("landing", material, (0.5, -4.0, 0.0))
    about = flying.position - flying.position.mean(0)
    spinning = replace(flying, name="spinning", velocity=np.cross((0.0, 0.0, 20.0), about))
    bursting = replace(flying, name="bursting", velocity=10.0 * about)
    noise = np.random.default_rng(0)
    for record in recorded(flying, landing, spinning, bursting, steps=40, every=every, keyframe_every=10):
        assert contradiction(record) is None, record.name
        noisy = record.position + 1e-3 * noise.standard_normal(record.position.shape)
        assert contradiction(replace(record, position=noisy.astype(np.float32), keyframes=None)) is None, record.name


def test_a_start_against_its_own_velocities_is_named_once_for_a_file(caplog):
    record = recorded(high(), steps=40)[0]
    assert record.initial_velocity is not None
    still = replace(record, initial_velocity=0.0 * record.initial_velocity, source="x.h5")
    name_contradictions([still, replace(still, name="other"), record])
    (line,) = caplog.messages
    assert line.startswith(
        "x.h5: scene 'cube': between the first two frames its particles move by (0.00125, -0.00504, 0) m on average, "
        "initial_velocity says (0, -3.68e-05, 0) m; the start is taken for undeformed"
    )
    assert line.endswith("(and 1 more scenes)")
    about = record.position[0] - record.position[0].mean(0)
    spinning = replace(high(), velocity=np.cross((0.0, 0.0, 20.0), about))
    record = recorded(spinning, steps=40)[0]
    text = contradiction(replace(record, initial_velocity=np.zeros_like(record.position[0])))
    assert text is not None
    assert "about their mean" in text


def test_a_start_that_is_deformed_is_seen_in_its_restart_states():
    record = recorded(replace(high(), deformation=np.tile(0.9 * np.eye(3), (64, 1, 1))), every=2, keyframe_every=2)[0]
    assert record.keyframes is not None
    later = record.keyframes.at(slice(1, None))
    assert contradiction(record) is None, "the restart state at the start says so"
    text = contradiction(replace(record, keyframes=later))
    assert text is not None
    assert "its restart state at step 2 is strained by" in text


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda record: {"time": 1e3 * record.time}, r"accelerate by .*-9.8e-06.*times in ms\?"),
        (lambda record: {"time": 1.0 * np.arange(len(record.time))}, r"times in frames, 200 a second\?"),
        (lambda record: {"time": record.time / 60.0}, r"times in minutes\?"),
        (
            lambda record: {"time": 1e-8 * record.time, "position": 0.0 * record.position + 0.5},
            "less than one|steps of",
        ),
        (lambda record: {"time": 1e5 * record.time, "position": 0.0 * record.position + 0.5}, "in another unit"),
    ],
)
def test_times_in_another_unit_are_refused(falling, change, message):
    check_record(falling)
    with pytest.raises(UserError, match=message):
        check_record(replace(falling, **change(falling)))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda record: {"time": 2.0 * record.time}, "times too long by a factor of 2?"),
        (lambda record: {"position": record.position[:, :, [0, 2, 1]]}, "do the axes agree?"),
        (lambda record: {"volume": 1e-6 * record.volume}, "its particles lie 0.067 m apart"),
        (
            lambda record: {"position": record.position[[0] * 21], "time": 1.11e3 * record.time},
            "in another unit, such as ms?",
        ),
    ],
)
def test_what_is_doubtful_gets_a_line(falling, change, message, caplog):
    check_record(replace(falling, **change(falling)))
    (line,) = caplog.messages
    assert message in line


HEADER = "time,marker,x,y,z\n"
BODY = ("scene.shape=cube", "scene.centre=[0.5,0.5,0.5]", "scene.side=0.3", "scene.particles_per_edge=5")


def table(folder: Path, text: str, *options: str):
    (folder / "m.csv").write_text(text)
    config = compose_config("estimate", [f"observation.file={folder / 'm.csv'}", *BODY, *options])
    return observation_from(config, material_named("sand"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (f"{HEADER}0,a,.5,.5,.5\n0,b,,,\n.01,a,.5,.49,.5\n.01,b,.6,.5,.5\n", "1 of 2 markers were not seen at time 0"),
        (f"{HEADER}0,a,.5,.5,.5\n.01,a,.5,,.5\n.02,a,.5,.5,.5\n", "1 positions lack a coordinate and are not used"),
        (f"{HEADER}0,a,.5,.5,.5\n.01,a,,,\n.02,a,.5,.5,.5\n", "1 of 3 frames show nothing and are not used"),
        ("time,marker,x,y,z,camera\n0,a,.5,.5,.5,1\n.01,a,.5,.49,.5,1\n", "not read: the columns camera"),
    ],
)
def test_parts_of_a_table_that_are_not_used_are_named(text, message, tmp_path, caplog):
    table(tmp_path, text)
    assert any(message in line for line in caplog.messages), caplog.messages


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            f"{HEADER}0,a,.5,.5,.5\n0.1,a,.5,.49,.5\n.1,a,.5,.48,.5\n",
            "line 4: marker 'a' has a second position at 0.1 s",
        ),
        (
            f"{HEADER}0,a,500,500,500\n.01,a,500,490,500\n",
            r"far beyond the domain of 1 m; metres expected; positions in mm\?",
        ),
        (f"{HEADER}0,a,50,50,50\n.01,a,50,49,50\n", r"positions in cm or mm\?"),
        (f"{HEADER}0,a,.5,.5,.5\n1e-5,a,.5,.5,.5\n", "less than one|steps of"),
        (
            HEADER + "".join(f"0,m{k},{1e-3 * k},0.001,0.001\n" for k in range(9)) + "1,m0,0,0,0\n",
            "the markers span 0.008 m and the body 0.24 m: in another unit",
        ),
    ],
)
def test_what_a_table_cannot_mean_is_refused(text, message, tmp_path):
    with pytest.raises(UserError, match=message):
        table(tmp_path, text)


def test_frames_that_nobody_gets_are_named_or_refused(in_process, tmp_path, caplog):
    small = ("scene.particles_per_edge=3", "picture=false", "output=x.h5", "simulation.steps=7")
    assert in_process(simulate, "simulate", *small).status == 0
    assert "simulation.every=5: the last 2 of 7 steps are in no frame" in caplog.messages
    for task, entry, options, message in (
        (
            simulate,
            "simulate",
            (*small, "keyframe_every=8"),
            "keyframe_every=8 keeps the start alone; accepted: 0 to 7",
        ),
        (observe, "observe", ("file=x.h5", "every=2"), "every=2 sees the start alone; accepted: 1 to 1"),
    ):
        done = in_process(task, entry, *options)
        assert done.status == 2
        assert message in done.err


def test_a_data_set_says_that_it_draws_its_motions(in_process, tmp_path, caplog):
    points(tmp_path / "p.npz")
    plan = ("simulation.steps=20", "data.train_scenes=1", "data.validation_scenes=1", "scene.particles=p.npz")
    assert in_process(generate, "generate", *plan, "material=elasticity", "output=d").status == 0
    assert any(
        "scene.particles=p.npz: its velocities and deformations are not used" in line for line in caplog.messages
    )


def test_a_known_velocity_goes_before_that_of_the_file(tmp_path):
    record = recorded(high(), steps=10)[0]
    write_scenes(tmp_path / "x.h5", [record])
    given = [f"observation.file={tmp_path / 'x.h5'}", "scene.velocity=[0,-1,0]", "scene.spin=[0,0,2]"]
    seen = observation_from(compose_config("estimate", given), material_named("elasticity"))
    x, y, _ = (seen.position - seen.position.mean(0)).T
    assert seen.initial_velocity is not None
    np.testing.assert_allclose(seen.initial_velocity, np.stack((-2.0 * y, 2.0 * x - 1.0, 0.0 * x), 1), atol=1e-7)
