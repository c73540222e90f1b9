"""Going on from a recorded frame: k steps, a file and N - k steps are N steps to the last bit, for all that moves."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from conftest import Outcome

import pcnclaws as pc
from benchmarks.remembering_material import CLAY
from pcnclaws.data.hdf5 import read_scenes
from pcnclaws.evaluate import evaluate
from pcnclaws.simulate import simulate
from pcnclaws.simulation.records import SceneRecord

STEPS, EVERY = 24, 6
OPTIONS = ("law=analytic", "picture=false", "scene.side=0.2", "scene.particles_per_edge=4", "simulation.every=6")
PISTON = "scene.colliders=[{shape: plane, point: [0.38,0,0], normal: [1,0,0], velocity: [2,0,0], start: 0.002}]"
PUSH = "scene.loads=[{low: [0,0,0], high: [0.5,1,1], force: [0,3,9], start: 0.004, end: 0.01}]"
MOVED = (PISTON, PUSH, "scene.centre=[0.5,0.22,0.5]")


def same_end(later: SceneRecord, whole: SceneRecord) -> None:
    """Compares frames and restart states of a run that goes on with those of the whole run, bit by bit."""
    frames = len(later.time)
    np.testing.assert_array_equal(later.position, whole.position[-frames:])
    np.testing.assert_array_equal(later.velocity, whole.velocity[-frames:])  # pyright: ignore[reportOptionalSubscript]
    assert later.keyframes is not None
    assert whole.keyframes is not None
    for name in ("affine", "deformation"):
        values = getattr(later.keyframes, name)
        np.testing.assert_array_equal(values, getattr(whole.keyframes, name)[-len(values) :])
    for name, values in later.keyframes.internal.items():
        np.testing.assert_array_equal(values, whole.keyframes.internal[name][-len(values) :])


@pytest.mark.parametrize(
    "options",
    [
        pytest.param(("material=sand", *MOVED), id="moving collider and load"),
        pytest.param(
            ("material=plasticine", "precision=float64", *MOVED), id="double precision", marks=pytest.mark.slow
        ),
        pytest.param(("material=elasticity", "scene.velocity=[0.3,-1,0.1]"), id="in free fall"),
        pytest.param(
            ("material=sand", "scene.spin=[0,3,1]", "scene.centre=[0.5,0.23,0.5]", "simulation.transfer=axpic2"),
            id="spinning",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_a_command_goes_on_as_if_it_had_not_stopped(
    options: tuple[str, ...], in_process: Callable[..., Outcome]
) -> None:
    def run(output: str, steps: int, *others: str) -> SceneRecord:
        said = (f"simulation.steps={steps}", "keyframe_every=6", f"output={output}")
        done = in_process(simulate, "simulate", *others, *said)
        assert (done.status, done.err) == (0, "")
        return read_scenes(output)[0]

    whole = run("whole.h5", STEPS, *OPTIONS, *options)
    again = [one for one in (*OPTIONS, *options) if not one.startswith("scene.") or one in MOVED[:2]]
    middle = run("middle.h5", 6, *again, "scene.particles=whole.h5", "scene.frame=1")
    np.testing.assert_array_equal(middle.position, whole.position[1:3])
    if "material=elasticity" in options:  # a fall knows its start from the file that holds it
        same_end(run("last.h5", STEPS - 12, *again, "scene.particles=whole.h5", "scene.frame=-3"), whole)
    else:
        same_end(run("last.h5", STEPS - 12, *again, "scene.particles=middle.h5", "scene.frame=-1"), whole)


@pytest.mark.parametrize("dtype", [torch.float32, pytest.param(torch.float64, marks=pytest.mark.slow)])
def test_a_program_goes_on_as_if_it_had_not_stopped(dtype: torch.dtype, tmp_path: Path) -> None:
    stamp = pc.Collider.box(low=(0.3, 0.33, 0.3), high=(0.7, 0.45, 0.7), velocity=(0.2, -2.0, 0), start=0.002)
    body = pc.Body.cube(side=0.2, centre=(0.5, 0.22, 0.5), particles_per_edge=4)
    scene = pc.Scene(
        body, pc.analytic_law(CLAY), velocity=(0, -2, 0), spin=(0, 2, 0), colliders=[stamp], youngs_modulus=3e5
    )
    whole = scene.simulate(STEPS, EVERY, dtype, deformation=True)
    assert whole.internal["plastic_strain"].shape == (5, 64)
    assert float(whole.internal["plastic_strain"][2].max()) > 0.0, "it has hardened by then"
    first = scene.simulate(12, EVERY, dtype, deformation=True)
    for source in (first, first.save(tmp_path / "first.h5")):
        later = scene.restarted(source)
        same_end(later.simulate(STEPS - 12, EVERY, dtype, deformation=True).record, whole.record)
    found = scene.restarted(whole, frame=2).rollout(STEPS - 12, EVERY, dtype=dtype)
    torch.testing.assert_close(found, whole.position[2:], rtol=0, atol=1e-5 if dtype == torch.float32 else 1e-12)
    fresh = scene.with_(velocity=first.velocity[-1]).simulate(STEPS - 12, EVERY, dtype).position
    assert float((fresh[-1] - whole.position[-1]).abs().max()) > 1e-2, "the state matters"


def test_internal_variables_go_into_files(tmp_path: Path) -> None:
    body = pc.Body.cube(side=0.2, centre=(0.5, 0.22, 0.5), particles_per_edge=2)
    motion = pc.Scene(body, pc.analytic_law(CLAY), velocity=(0, -2, 0)).simulate(40, 20, deformation=True)
    with np.load(motion.save(tmp_path / "x.npz")) as file:
        np.testing.assert_array_equal(file["internal_plastic_strain"], motion.internal["plastic_strain"].numpy())
    assert 'Name="internal_plastic_strain"' in motion.save(tmp_path / "x.vtu").read_text()
    assert motion.internal["plastic_strain"][-1].max() > 0.0
    assert pc.Scene(body, pc.analytic_law(CLAY)).simulate(20, 20).internal == {}


def test_a_scene_that_goes_on_keeps_its_state_and_says_what_is_otherwise(caplog: pytest.LogCaptureFixture) -> None:
    scene = pc.Scene(pc.Body.cube(side=0.2, particles_per_edge=4), pc.analytic_law("sand"), velocity=(0, -2, 0))
    motion = scene.simulate(40, 20, deformation=True)
    later = scene.restarted(motion)
    assert not caplog.messages
    stiffer = later.with_(youngs_modulus=2.5e5)
    assert (
        "frame=-1 of scene 'cube' goes on otherwise than it was recorded: parameters.youngs_modulus=250000"
        in (caplog.messages[-1])
    )
    assert torch.equal(stiffer.simulate(20, 20).position[0], motion.position[-1])
    with pytest.raises(pc.UserError, match=r"scene\.velocity has no effect"):
        later.with_(velocity=(0, 0, 0))
    with pytest.raises(pc.UserError, match=r"frame=3 does not exist in scene 'cube'; accepted: -3 to 2"):
        scene.restarted(motion, frame=3)
    with pytest.raises(pc.UserError, match="holds no restart state; accepted: files with restart states"):
        scene.restarted(scene.simulate(40, 20))
    with pytest.raises(pc.UserError, match=r"has 64 particles; accepted: those of the scene, 8"):
        scene.with_(body=pc.Body.cube(side=0.2, particles_per_edge=2)).restarted(motion)


def test_frames_without_restart_state_and_options_without_effect_are_refused(
    in_process: Callable[..., Outcome], caplog: pytest.LogCaptureFixture
) -> None:
    run = (simulate, "simulate", "material=sand", *OPTIONS[:2])
    assert in_process(*run, *OPTIONS[2:], "simulation.steps=24", "keyframe_every=12", "output=a.h5").status == 0
    for option, message in (
        (
            "scene.frame=1",
            "scene.frame=1 of a.h5: scene 'cube' (step 6) holds no restart state; accepted: frames",
        ),
        ("scene.frame=9", "scene.frame=9 does not exist in a.h5: scene 'cube'; accepted: -5 to 4"),
        ("scene.frame=end", "scene.frame=end does not exist"),
    ):
        done = in_process(*run, "scene.particles=a.h5", option, "output=b.h5")
        assert done.status == 2
        assert message in done.err
        assert done.err.count("\n") == 1
    spun = in_process(*run, "scene.particles=a.h5", "scene.frame=2", "scene.spin=[0,1,0]", "output=b.h5")
    assert "scene.spin=[0, 1, 0] has no effect beside scene.frame" in spun.err
    assert "scene.frame=2 has no effect without scene.particles=FILE.h5" in in_process(*run, "scene.frame=2").err
    done = in_process(
        *run,
        "scene.particles=a.h5",
        "scene.frame=2",
        "parameters.friction_angle=20",
        "simulation.steps=10",
        "output=b.h5",
    )
    assert done.status == 0
    assert "goes on otherwise than it was recorded: parameters.friction_angle=20.0 instead of" in caplog.text


def test_what_starts_deformed_is_evaluated_from_there(in_process: Callable[..., Outcome]) -> None:
    pressed = ("material=plasticine", "scene.centre=[0.5,0.21,0.5]", "scene.velocity=[0,-3,0]")
    made = in_process(
        simulate, "simulate", *OPTIONS, *pressed, "simulation.steps=40", "keyframe_every=20", "output=a.h5"
    )
    assert made.status == 0
    again = ("material=plasticine", *OPTIONS[:2], "scene.particles=a.h5", "scene.frame=-1", "simulation.steps=20")
    assert in_process(simulate, "simulate", *again, "output=b.h5").status == 0
    asked = ("trajectories=b.h5", "law=analytic", "material=plasticine", "picture=false", "output=m.json")
    assert in_process(evaluate, "evaluate", *asked).status == 0
    assert '"mse": 0.0,' in Path("m.json").read_text()


def test_a_file_that_starts_hardened_starts_a_scene_hardened(own_registry, in_process: Callable[..., Outcome]) -> None:
    law = pc.analytic_law(CLAY)
    pc.register(law.material)
    body = pc.Body.cube(side=0.2, centre=(0.5, 0.22, 0.5), particles_per_edge=3)
    scene = pc.Scene(body, law, velocity=(0, -2, 0))
    motion = scene.simulate(60, 30, deformation=True)
    scene.restarted(motion, frame=1).simulate(30, 30, deformation=True).save("later.h5")
    (record,) = read_scenes("later.h5")
    assert record.keyframes is not None
    assert record.keyframes.internal["plastic_strain"][0].max() > 0.0
    options = (
        f"material={CLAY.name}",
        *OPTIONS[:2],
        "scene.particles=later.h5",
        "simulation.steps=30",
        "keyframe_every=30",
    )
    assert in_process(simulate, "simulate", *options, "simulation.every=30", "output=x.h5").status == 0
    same_end(read_scenes("x.h5")[0], motion.record)
