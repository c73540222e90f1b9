"""Scenes of a program: the motions of the commands, their derivatives, and what is refused."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch.autograd import forward_ad, gradcheck

import pcnclaws as pc
from pcnclaws.data.hdf5 import read_scenes
from pcnclaws.simulate import simulate

ANGLES = {"youngs_modulus": 3e5, "poissons_ratio": 0.25, "friction_angle": 30.0}


def small(**changes: Any) -> pc.Scene:
    """A little cube of sand that stands just above the floor and moves towards it."""
    body = pc.Body.cube(side=0.2, centre=(0.5, 0.22, 0.5), particles_per_edge=4)
    arguments: dict[str, Any] = {"velocity": (0.3, -2.0, 0.0), "spin": (0.0, 1.0, 3.0), **changes}
    return pc.Scene(body, arguments.pop("law", pc.analytic_law("sand")), **arguments)


def smallest(**changes: Any) -> pc.Scene:
    """Eight particles that feel the floor from the first step on."""
    body = pc.Body.cube(side=0.1, centre=(0.5, 0.17, 0.5), particles_per_edge=2)
    return small(**changes).with_(body=body)


# of PyTorch's own forward mode
JIT = pytest.mark.filterwarnings("ignore:`torch.jit.script` is deprecated:DeprecationWarning")
OPTIONS = ("scene.side=0.2", "scene.centre=[0.5,0.22,0.5]", "scene.particles_per_edge=4", "simulation.steps=60")
MOVING = ("scene.velocity=[0.3,-2,0]", "scene.spin=[0,1,3]")


@pytest.mark.parametrize(
    ("law", "precision", "auto"),
    [("analytic", "float32", False), ("analytic", "float64", True), ("pretrained", "float32", True)],
)
def test_a_motion_is_that_of_the_command_to_the_last_bit(law, precision, auto, in_process, tmp_path):
    step = ("simulation.time_step=auto",) if auto else ()
    given = (*OPTIONS, *MOVING, *step, f"law={law}", f"precision={precision}", "parameters.friction_angle=31")
    assert in_process(simulate, "simulate", *given, "keyframe_every=20", "picture=false", "output=c.h5").status == 0
    model = pc.analytic_law("sand") if law == "analytic" else pc.load_law("sand")
    scene = small(law=model, friction_angle=31, settings=pc.Settings(time_step="auto") if auto else None)
    motion = scene.simulate(60, 20, getattr(torch, precision), deformation=True)
    motion.save(tmp_path / "p.h5")
    commanded, own = read_scenes(tmp_path / "c.h5")[0], read_scenes(tmp_path / "p.h5")[0]
    assert (own.settings, own.parameters, own.material) == (commanded.settings, commanded.parameters, "sand")
    at = commanded.frame_steps().tolist().index
    frames = [at(step) for step in own.frame_steps()]
    np.testing.assert_array_equal(own.position, commanded.position[frames])
    np.testing.assert_array_equal(motion.position.numpy(), own.position)
    assert motion.deformation is not None
    assert commanded.keyframes is not None
    np.testing.assert_array_equal(motion.deformation.numpy(), commanded.keyframes.deformation)
    assert {str(one.dtype) for one in (motion.position, motion.velocity, motion.deformation)} == {f"torch.{precision}"}
    assert own.position.dtype == precision


def test_points_with_velocities_of_their_own_move_as_those_of_a_point_file(in_process, tmp_path):
    random = np.random.default_rng(0)
    cube = pc.Body.cube(side=0.2, centre=(0.5, 0.22, 0.5), particles_per_edge=4)
    velocity = np.array((0.0, -2.0, 0.0)) + 0.3 * random.standard_normal((64, 3))
    density = np.linspace(800.0, 1500.0, 64)
    arrays = {"position": cube.position.numpy(), "volume": cube.volume.numpy(), "density": density}
    np.savez(tmp_path / "p.npz", velocity=velocity, allow_pickle=False, **arrays)
    given = ("scene.particles=p.npz", "simulation.steps=60", "precision=float64", "picture=false", "output=c.h5")
    assert in_process(simulate, "simulate", *given).status == 0
    scene = pc.Scene(pc.Body.points(**arrays), pc.analytic_law("sand"), velocity=velocity)
    motion = scene.simulate(60, 60, torch.float64)
    np.testing.assert_array_equal(motion.position[-1].numpy(), read_scenes(tmp_path / "c.h5")[0].position[-1])


def test_a_rollout_is_the_simulation(each_backend):
    scene = smallest(friction_angle=32.0)
    for dtype in (torch.float32, torch.float64):
        positions = scene.rollout(6, 6, dtype=dtype)
        assert positions.dtype == dtype
        torch.testing.assert_close(positions, scene.simulate(6, 6, dtype).position, rtol=0, atol=0)


def test_gradients_reach_parameters_velocity_spin_and_values_of_each_particle():
    scene = smallest()
    double = {"dtype": torch.float64, "requires_grad": True}
    angle, scale = torch.tensor(31.0, **double), torch.tensor(1.0, **double)
    each = torch.linspace(0.2, 0.3, 8, **double)
    velocity, spin = torch.tensor((0.3, -2.0, 0.1), **double), torch.tensor((1.0, 0.5, 2.0), **double)

    def end(angle: torch.Tensor, scale: torch.Tensor, each: torch.Tensor, velocity: torch.Tensor, spin: torch.Tensor):
        given: dict[str, Any] = {"friction_angle": angle, "youngs_modulus": 3e5 * scale, "poissons_ratio": each}
        return scene.rollout(20, 20, velocity=velocity, spin=spin, **given)[-1]

    assert gradcheck(end, (angle, scale, each, velocity, spin), eps=1e-6, atol=1e-7, rtol=1e-4, fast_mode=True)


def test_gradients_of_a_velocity_of_each_particle_go_through_its_gradient():
    scene = smallest(spin=(0, 0, 0))
    velocity = torch.randn(8, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0), requires_grad=True)
    assert gradcheck(lambda v: scene.rollout(15, 15, velocity=v)[-1], (velocity,), eps=1e-6, fast_mode=True)


@JIT
def test_the_sensitivity_is_the_derivative_of_the_rollout():
    scene = smallest(law=pc.load_law("sand"))
    angle = torch.tensor(28.0, dtype=torch.float64)
    found = scene.sensitivity("friction_angle", 20, 10, dtype=torch.float64)
    assert found.shape == (3, 8, 3)
    assert not found[0].any()
    with torch.no_grad(), forward_ad.dual_level():
        dual = scene.rollout(20, 10, friction_angle=forward_ad.make_dual(angle, torch.ones_like(angle)))
        torch.testing.assert_close(found, forward_ad.unpack_dual(dual).tangent, rtol=0, atol=0)
    angle.requires_grad_()
    weight = torch.randn(found.shape, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    (pulled,) = torch.autograd.grad((weight * scene.rollout(20, 10, friction_angle=angle)).sum(), angle)
    torch.testing.assert_close(pulled, (weight * found).sum(), rtol=1e-9, atol=0)


def test_gradients_reach_the_weights_of_a_law_in_another_precision(each_backend):
    law = pc.load_law("sand").requires_grad_()
    scene = smallest(law=law)
    scene.rollout(6, 6)[-1].sum().backward()
    single = [weight.grad for weight in law.parameters()]
    law.zero_grad()
    scene.rollout(6, 6, dtype=torch.float64)[-1].sum().backward()
    for one, weight in zip(single, law.parameters(), strict=True):
        assert one is not None
        assert weight.grad is not None
        assert weight.grad.dtype == torch.float32
        assert weight.grad.abs().max() > 0
        torch.testing.assert_close(one, weight.grad, rtol=2e-2, atol=2e-2 * float(one.abs().max()))


def test_a_batch_is_its_scenes_one_by_one():
    body = pc.Body.sphere(side=0.2, centre=(0.4, 0.3, 0.5), particles_per_edge=5)
    scenes = [small(), small(friction_angle=20.0, velocity=(0, 0, 0)), small(law=pc.load_law("sand"))]
    scenes += [scenes[0].with_(body=body), small(settings=pc.Settings(time_step=2e-4))]
    scenes += [scenes[0].with_(settings=pc.Settings(transfer="axpic2"), spin=(0, spin, 0)) for spin in (1, 5)]
    together = pc.simulate_scenes(scenes, 60, 20)
    for scene, motion in zip(scenes, together, strict=True):
        alone = scene.simulate(60, 20)
        for name in ("time", "position", "velocity"):
            torch.testing.assert_close(getattr(motion, name), getattr(alone, name), rtol=0, atol=0)


def test_obstacles_and_loads_are_those_of_the_command(in_process, tmp_path):
    around = (
        "scene.colliders=[{shape: plane, point: [0,0.155,0], normal: [0.1,1,0], friction: 0.3}]",
        "scene.loads=[{low: [0,0,0], high: [1,0.2,1], force: [0,0,4]}]",
    )
    assert in_process(simulate, "simulate", *OPTIONS, *MOVING, *around, "picture=false", "output=c.h5").status == 0
    floor = pc.Collider.plane(point=(0, 0.155, 0), normal=(0.1, 1, 0), friction=0.3)
    push = pc.Load(low=(0, 0, 0), high=(1, 0.2, 1), force=(0, 0, 4))
    motion = small(colliders=[floor], loads=[push]).simulate(60, 20)
    commanded = read_scenes(tmp_path / "c.h5")[0]
    np.testing.assert_array_equal(motion.position.numpy(), commanded.position[::4])
    assert motion.impulses.shape == (4, 1, 3)
    assert float(motion.impulses[-1, 0, 1]) > 0
    (saved,) = read_scenes(motion.save(tmp_path / "p.h5"))
    assert saved.settings == commanded.settings


def test_gradients_reach_friction_and_motion_of_a_collider_and_a_load():
    double = {"dtype": torch.float64, "requires_grad": True}
    friction, force = torch.tensor(0.3, **double), torch.tensor((0.0, 0.0, 1.0), **double)
    velocity = torch.tensor((0.1, 0.5, 0.0), **double)
    scene = smallest()

    def end(friction: torch.Tensor, velocity: torch.Tensor, force: torch.Tensor) -> torch.Tensor:
        floor = pc.Collider.plane(point=(0, 0.11, 0), normal=(0, 1, 0), friction=friction, velocity=velocity)
        push = pc.Load(low=(0, 0, 0), high=(1, 1, 1), force=force)
        return scene.rollout(20, 20, colliders=[floor], loads=[push])[-1]

    found = end(friction, velocity, force)
    assert found.dtype == torch.float64
    assert all(float(g.abs().max()) > 1e-5 for g in torch.autograd.grad(found.sum(), (friction, velocity, force)))
    assert gradcheck(end, (friction, velocity, force), eps=1e-6, atol=1e-8, fast_mode=True)


def test_domains_of_other_sizes():
    law, body = pc.analytic_law("elasticity"), pc.Body.cube(side=2.0, centre=(5, 3, 5), particles_per_edge=5)
    hall = pc.Settings(domain=((0, 0, 0), (10, 20, 10)), grid_spacing=0.5, wall_distance=1.0, time_step="auto")
    fallen = pc.Scene(body, law, settings=hall, velocity=(0, -8, 0)).simulate(40, 40).position[-1]
    assert float(fallen[:, 1].min()) > 0.7
    free = pc.Scene(body, law, settings=pc.Settings(domain=None, grid_spacing=0.5)).simulate(1000, 1000)
    # y0 - g dt^2 n (n + 1) / 2
    drop = 9.8 * 5e-4**2 * 1000 * 1001 / 2
    torch.testing.assert_close(free.position[-1], free.position[0] - torch.tensor((0, drop, 0)), rtol=0, atol=1e-4)


def test_one_value_a_particle_is_that_value_where_all_are_the_same():
    same = small(friction_angle=torch.full((64,), 31.0), youngs_modulus=np.full(64, 3e5)).simulate(60, 60)
    torch.testing.assert_close(
        same.position, small(friction_angle=31.0, youngs_modulus=3e5).simulate(60, 60).position, rtol=0, atol=0
    )
    halves = torch.where(torch.arange(64) < 32, 20.0, 35.0)
    assert (small(friction_angle=halves).simulate(60, 60).position - same.position)[-1].abs().max() > 1e-6


def test_missing_parameters_are_mid_range_and_with_changes_one_thing():
    scene = small(friction_angle=31.0)
    assert scene.parameters == {"youngs_modulus": 4e5, "poissons_ratio": 0.25, "friction_angle": 31.0}
    assert scene.with_(youngs_modulus=3e5).parameters == {**ANGLES, "friction_angle": 31.0}
    assert scene.parameters["youngs_modulus"] == 4e5


@JIT
def test_precision_is_that_of_the_tensors():
    half, angle = torch.tensor(30.0), torch.tensor(30.0, dtype=torch.float64)
    assert small().rollout(2, 1).dtype == torch.float32
    assert small(friction_angle=angle).simulate(2, 1).position.dtype == torch.float64
    assert small(friction_angle=angle).rollout(2, 1, friction_angle=half).dtype == torch.float32
    assert small(friction_angle=angle).sensitivity("friction_angle", 2, 1).dtype == torch.float64


def test_the_time_step_of_a_scene():
    scene = small(settings=pc.Settings(time_step="auto"))
    assert 0.395 < scene.cfl <= 0.4
    longest = scene.stable_time_step
    scene.with_(settings=pc.Settings(time_step=longest)).simulate(2, 1)
    with pytest.raises(pc.UserError, match="is unstable"):
        scene.with_(settings=pc.Settings(time_step=1.02 * longest)).rollout(2, 1)
    # the stiffest particle decides
    stiff = torch.where(torch.arange(64) == 7, 9e5, 2e5)
    assert scene.with_(youngs_modulus=stiff).stable_time_step == scene.with_(youngs_modulus=9e5).stable_time_step


def _run(**changes: Any) -> None:
    steps, every = changes.pop("steps", 5), changes.pop("every", 5)
    run = {name: changes.pop(name) for name in ("dtype", "device") if name in changes}
    small(**changes).simulate(steps, every, **run)


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "misspelt parameter": ({"friction_angel": 30.0}, "did you mean 'friction_angle'"),
    "misspelt argument": ({"velocty": 1.0}, "did you mean 'velocity'"),
    "parameter of another material": ({"yield_stress": 3e3}, "parameters='yield_stress' is not known"),
    "angle below 0": (
        {"friction_angle": -5},
        "parameters.friction_angle=-5 is not accepted; accepted: a finite number",
    ),
    "angle of 200": ({"friction_angle": 200.0}, "at least 0 and below 90"),
    "nan": ({"youngs_modulus": float("nan")}, "parameters.youngs_modulus=nan"),
    "nan in a tensor": ({"youngs_modulus": torch.tensor([3e5] * 63 + [float("nan")])}, "youngs_modulus=nan"),
    "one angle of many": ({"friction_angle": torch.linspace(20.0, 95.0, 64)}, "parameters.friction_angle=95"),
    "ratio of 0.5": ({"poissons_ratio": 0.5}, "above -1 and below 0.5"),
    "modulus below 0": ({"youngs_modulus": -1}, "above 0"),
    "a value for each of other particles": ({"friction_angle": torch.ones(63)}, "(63,)"),
    "no step": ({"steps": 0}, "simulation.steps=0 is not accepted; accepted: a whole number from 1"),
    "no frame": ({"every": 0}, "simulation.every=0"),
    "frames beyond the end": ({"every": 6}, "simulation.every=6 keeps no frame; accepted: 1 to simulation.steps=5"),
    "half": ({"dtype": torch.float16}, "torch.float32, torch.float64"),
    "device": ({"device": "tpu"}, "accepted: cpu"),
    "infinite velocity": ({"velocity": (0.0, float("inf"), 0.0)}, "scene.velocity"),
    "body in a collider": (
        {"colliders": [pc.Collider.sphere(centre=(0.5, 0.22, 0.5), radius=0.05)]},
        "is inside scene.colliders[0] (sphere)",
    ),
    "velocity of two": ({"velocity": (0.0, 1.0)}, "(2,)"),
}


@pytest.mark.parametrize("case", list(WRONG))
def test_wrong_input_is_one_line_that_names_it(case):
    changes, message = WRONG[case]
    with pytest.raises(pc.UserError) as caught:
        _run(**changes)
    assert message in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


SETTINGS: dict[str, tuple[dict[str, Any], str]] = {
    "misspelt": ({"time_stpe": 1e-4}, "did you mean 'time_step'"),
    "no time step": ({"time_step": 0.0}, "simulation.time_step=0.0 is out of range; accepted: a positive"),
    "nan": ({"density": float("nan")}, "simulation.density=nan"),
    "boundary": ({"boundary": "stickie"}, "did you mean 'sticky'"),
    "transfer": ({"transfer": "axpik2"}, "accepted: apic, axpic2, axpic3, axpic4; did you mean 'axpic2'"),
    "empty domain": ({"domain": ((0, 0, 0), (1, -1, 1))}, "simulation.domain"),
    "nodes of another box": ({"domain": ((0, 0, 0), (2, 2, 2)), "grid_nodes": 20}, "simulation.grid_spacing"),
    "cells that do not fit": ({"grid_spacing": 0.07}, "a whole number of cells"),
    "walls that do not hold": ({"wall_distance": 0.0}, "accepted: 0.05"),
    "thick walls": ({"wall_distance": 0.6}, "below 0.5"),
    "gravity of two": ({"gravity": (0.0, -9.8)}, "a list of 3"),
}


@pytest.mark.parametrize("case", list(SETTINGS))
def test_wrong_settings_are_one_line_that_names_them(case):
    changes, message = SETTINGS[case]
    with pytest.raises(pc.UserError, match=r"simulation") as caught:
        pc.Settings(**changes)
    assert message in str(caught.value)


def test_unstable_steps_and_bodies_outside_are_refused_in_the_words_of_the_command(in_process):
    for option, scene, starts in (
        ("simulation.time_step=0.01", lambda: small(settings=pc.Settings(time_step=0.01)), "simulation.time_step=0.01"),
        ("scene.centre=[0.5,0.1,0.5]", lambda: small().with_(body=pc.Body.cube(0.2, (0.5, 0.1, 0.5), 4)), "particle 0"),
    ):
        err = in_process(simulate, "simulate", *OPTIONS, *MOVING, option, "output=x.h5").err
        with pytest.raises(pc.UserError) as caught:
            scene().simulate(5)
        assert err.rstrip().endswith(str(caught.value).rpartition(f"{starts}")[2])


def test_a_diverged_scene_is_named_and_no_positions_come_back(tmp_path: Path):
    # soft bodies that hit the wall so fast that one turns inside out
    law, body = pc.analytic_law("elasticity"), pc.Body.cube(side=0.2, centre=(0.5, 0.3, 0.5), particles_per_edge=4)
    calm = pc.Scene(body, law, youngs_modulus=5e4, name="calm")
    wild = calm.with_(velocity=(0, -60, 0), name="wild")
    for run in (wild.simulate, wild.rollout, lambda *_: pc.simulate_scenes([calm, wild], 40, 20)):
        with pytest.raises(pc.SimulationDiverged, match=r"scene 'wild' diverged at step \d+: particle .*at most"):
            run(40, 20)


def test_what_is_doubtful_is_said_once(caplog):
    scene = pc.Scene(pc.Body.cube(particles_per_edge=4), pc.load_law("sand"), youngs_modulus=8e5)
    for angle in (25.0, 30.0):
        scene.rollout(2, 2, friction_angle=angle)
    said = "\n".join(caplog.messages)
    assert said.count("with less than 1 a cell a body breaks apart") == 1
    assert said.count("law=sand: used outside its training data: youngs_modulus=800000 (trained on") == 1
    scene.simulate(7, 5)
    assert "simulation.every=5: the last 2 of 7 steps are in no frame" in caplog.messages
