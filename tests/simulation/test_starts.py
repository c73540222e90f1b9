"""What a scene starts with: the gradient of its velocities, by options and by files, and estimates of real spins."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import torch
from observed_bodies import problem_of, solved, unknowns_of
from recordings import recording, written
from scipy.spatial.transform import Rotation

from pcnclaws.commands.composition import compose_config
from pcnclaws.commands.configuration import body_from, start_from
from pcnclaws.commands.data_sets import plan_from
from pcnclaws.commands.observation_setup import observation_from
from pcnclaws.data.hdf5 import read_scenes
from pcnclaws.data.observation import Observation
from pcnclaws.data.sampling import DataSetPlan, planned_scenes
from pcnclaws.errors import UserError
from pcnclaws.estimation.start_motion import with_first_motion
from pcnclaws.estimation.uncertainty import ROUNDING, uncertainty
from pcnclaws.evaluate import evaluate
from pcnclaws.geometry.shapes import particles
from pcnclaws.geometry.velocity_gradients import spin_gradient, velocity_gradients
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.materials import MATERIALS, material_named
from pcnclaws.mpm.diagnostics import angular_momentum
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.simulate import simulate
from pcnclaws.simulation.batch import batch_scenes
from pcnclaws.simulation.scenes import SceneStart, start_of
from pcnclaws.simulation.simulator import simulator_of

FREE = "simulation.gravity=[0,0,0]"
SPIN = (3.0, 5.0, -2.0)


def configured(*options: str) -> SceneStart:
    return start_from(compose_config("simulate", list(options)))


def momenta(start: SceneStart, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Angular momentum after each step, and that of the particles' velocities alone, each (steps + 1, 3)."""
    simulator = simulator_of(analytic_laws(MATERIALS[start.material]), start.settings).double()
    batch = batch_scenes([start], torch.float64)
    step, state, found = simulator.step_function(batch.scenes, batch.parameters), batch.state, []
    # about the centre, where a momentum of 1e-17 has no lever
    middle = state.position.mean(1, keepdim=True)
    with torch.no_grad():
        for _ in range(steps + 1):
            moved = state._replace(position=state.position - middle)
            both = (moved, moved._replace(affine=0.0 * moved.affine))
            found.append(
                [angular_momentum(one, batch.scenes, start.settings.grid_spacing)[:, 0].numpy() for one in both]
            )
            state = step(state)
    whole, alone = np.swapaxes(np.array(found), 0, 1)
    return whole, alone


@pytest.mark.parametrize("material", ["elasticity", "plasticine", "sand"])
@pytest.mark.parametrize("side", [0.1, 0.2, 0.5])
def test_a_body_that_is_given_a_spin_keeps_its_angular_momentum_from_the_first_step_on(
    material: str, side: float
) -> None:
    options = (f"material={material}", f"scene.side={side}", "scene.particles_per_edge=5", f"scene.spin={list(SPIN)}")
    start = configured(*options, FREE)
    np.testing.assert_array_equal(start.affine, np.broadcast_to(spin_gradient(SPIN), (125, 3, 3)))
    whole, alone = momenta(start, 10)
    np.testing.assert_allclose(whole, np.broadcast_to(whole[0], whole.shape), rtol=1e-10)
    length = np.linalg.norm(alone, axis=1)
    assert length.min() > 0.99 * length[0]
    lost = np.linalg.norm(momenta(configured(*options, FREE, "scene.affine=zero"), 1)[1], axis=1)
    assert lost[1] < (0.7, 0.9, 0.98)[(0.1, 0.2, 0.5).index(side)] * lost[0]


def test_a_single_particle_turns_about_itself(tmp_path: Path) -> None:
    point = tmp_path / "x.npz"
    np.savez(point, position=np.full((1, 3), 0.513), velocity=np.zeros((1, 3)), volume=np.full(1, 1e-4))
    start = configured("material=sand", f"scene.particles={point}", f"scene.spin={list(SPIN)}", FREE)
    whole, alone = momenta(start, 10)
    assert not alone[0].any()
    np.testing.assert_allclose(whole[0], 2.0 * 0.1 * 0.25 * 0.05**2 * np.array(SPIN), rtol=1e-12)
    np.testing.assert_allclose(whole, np.broadcast_to(whole[0], whole.shape), rtol=1e-9)


def cloud(count: int = 400) -> tuple[np.ndarray, np.ndarray]:
    """Points at random in a cube of side 0.3, and the volume of each."""
    return 0.35 + 0.3 * np.random.default_rng(2).random((count, 3)), np.full(count, 0.3**3 / count)


def test_the_gradient_of_an_affine_field_is_exact_also_at_the_surface() -> None:
    position, volume = cloud()
    gradient = np.random.default_rng(3).standard_normal((3, 3))
    found = velocity_gradients(position, position @ gradient.T + 1.0, volume)
    known = found.any((1, 2))
    assert known.mean() > 0.95, "but for some that have few neighbours"
    np.testing.assert_allclose(found[known], np.broadcast_to(gradient, found[known].shape), atol=1e-9)
    for edge, lattice in ((2, "faces"), (3, "centres")):
        cube = particles(particles_per_edge=edge, lattice=lattice)
        found = velocity_gradients(cube.position, cube.position @ gradient.T, cube.volume)
        np.testing.assert_allclose(found, np.broadcast_to(gradient, found.shape), atol=1e-9)
    assert not velocity_gradients(position, np.ones_like(position), volume).any(), "one velocity has no gradient"


def test_particles_that_few_others_are_near_have_no_gradient() -> None:
    random = np.random.default_rng(4)
    cube = particles(side=0.1, particles_per_edge=3)
    position, volume = np.concatenate((cube.position, np.full((1, 3), 0.8))), np.full(28, cube.volume[0])
    velocity = random.standard_normal((28, 3))
    found = velocity_gradients(position, velocity, volume)
    assert found[:27].any((1, 2)).all()
    assert not found[27].any()
    for count in (1, 4):
        assert not velocity_gradients(position[:count], velocity[:count], volume[:count]).any()


def test_two_bodies_that_pass_each_other_do_not_shear_one_another() -> None:
    one = particles(centre=(0.3, 0.5, 0.5), side=0.2, particles_per_edge=4, lattice="centres")
    position = np.concatenate((one.position, one.position + np.array((0.3, 0.0, 0.0))))
    velocity = np.repeat(((0.0, 1.0, 0.0), (0.0, -1.0, 0.0)), 64, axis=0)
    assert not velocity_gradients(position, velocity, np.tile(one.volume, 2)).any()


def turning_points(path: Path) -> str:
    """An .npz of a cloud that moves and turns as a rigid body, as the option that names it."""
    position, volume = cloud()
    velocity = np.array((1.0, 0.0, 0.5)) + np.cross(SPIN, position - position.mean(0))
    np.savez(path, position=position, velocity=velocity, volume=volume)
    return f"scene.particles={path}"


def test_points_start_with_the_gradient_of_their_velocities_and_of_the_spin_that_is_added(tmp_path: Path) -> None:
    points = turning_points(tmp_path / "x.npz")
    start = configured(points)
    assert start.affine is not None
    known = start.affine.any((1, 2))
    np.testing.assert_allclose(start.affine[known], np.tile(spin_gradient(SPIN), (known.sum(), 1, 1)), atol=1e-9)
    faster = configured(points, f"scene.spin={list(SPIN)}").affine
    assert faster is not None
    np.testing.assert_allclose(faster, start.affine + spin_gradient(SPIN), atol=1e-12)
    assert configured(points, "scene.affine=zero").affine is None
    with pytest.raises(UserError, match=r"scene.affine='velocities' is not known; .*did you mean 'velocity'"):
        configured(points, "scene.affine=velocities")


def test_what_simulate_writes_starts_again_as_it_did(in_process, tmp_path: Path) -> None:
    options = ("material=elasticity", "law=analytic", "scene.side=0.2", "scene.particles_per_edge=4", "picture=false")
    done = in_process(simulate, "simulate", *options, "scene.spin=[0,5,0]", "simulation.steps=10", "output=x.h5")
    assert done.status == 0, done.err
    (record,) = read_scenes("x.h5")
    gradient = np.broadcast_to(spin_gradient((0, 5, 0)), (64, 3, 3))
    np.testing.assert_array_equal(start_of(record).affine, gradient)
    np.testing.assert_array_equal(configured("scene.particles=x.h5").affine, gradient)
    seen = compose_config("estimate", ["material=elasticity", "observation.file=x.h5"])
    np.testing.assert_array_equal(observation_from(seen, material_named("elasticity")).initial_affine, gradient)
    # the same C, so the same motion: without it the first step would take 12 % of the spin
    asked = ("trajectories=x.h5", "law=analytic", "material=elasticity", "picture=false", "output=m.json")
    assert in_process(evaluate, "evaluate", *asked).status == 0
    assert '"mse": 0.0,' in Path("m.json").read_text()


def test_a_trajectory_file_that_does_not_say_otherwise_starts_with_none(tmp_path: Path) -> None:
    turning = np.tile((0.0, 1.0, 0.0), (5, 1)).astype(np.float32)
    record = replace(recording(keyframes=False), initial_velocity=turning)
    path = written(tmp_path / "x.h5", record)
    assert start_of(read_scenes(path)[0]).affine is None
    assert configured(f"scene.particles={path}").affine is None
    with h5py.File(path, "a") as file:
        file["scenes/thrown/initial_affine"] = np.full((5, 3, 3), 2.0)
    for affine in (start_of(read_scenes(path)[0]).affine, configured(f"scene.particles={path}").affine):
        np.testing.assert_array_equal(affine, np.full((5, 3, 3), 2.0))
    assert configured(f"scene.particles={path}", "scene.affine=zero").affine is None
    assert configured(f"scene.particles={path}", "scene.affine=velocity").affine is None, "that of one velocity"
    # a full state at the start goes before
    whole = replace(recording(), initial_affine=np.ones((5, 3, 3), np.float32))
    assert whole.keyframes is not None
    (again,) = read_scenes(written(tmp_path / "y.h5", whole))
    np.testing.assert_array_equal(start_of(again).affine, whole.keyframes.affine[0])


@pytest.mark.parametrize(
    ("values", "message"),
    [(np.zeros((5, 3)), "'initial_affine' has the shape"), (np.full((5, 3, 3), np.nan), "'initial_affine' holds")],
)
def test_a_wrong_gradient_in_a_file_is_one_line(values: np.ndarray, message: str, tmp_path: Path) -> None:
    path = written(tmp_path / "x.h5")
    with h5py.File(path, "a") as file:
        file["scenes/thrown/initial_affine"] = values
    with pytest.raises(UserError, match=message):
        read_scenes(path)


def test_data_sets_start_as_in_the_paper() -> None:
    plan = plan_from(compose_config("generate", ["material=sand"]))
    np.testing.assert_array_equal(plan.body.position, DataSetPlan(material_named("sand")).body.position)
    assert plan.body.position.min() == 0.25, "on the faces"
    starts = [start for scenes in planned_scenes(plan).values() for start in scenes]
    assert all(start.affine is None for start in starts)
    with pytest.raises(UserError, match="scene.affine=velocity is not accepted here"):
        plan_from(compose_config("generate", ["material=sand", "scene.affine=velocity"]))
    np.testing.assert_array_equal(body_from(compose_config("train").scene).position, plan.body.position)


def flight(spin: tuple[float, float, float], **fields: Any) -> Observation:
    """Markers, with a noise of 0.2 mm, on a cube that flies and turns as a rigid body, without contact."""
    body, settings = particles(side=0.15, particles_per_edge=3, lattice="centres"), SimulationSettings()
    time = np.linspace(0.0, 0.02, 5)
    turned = [0.5 + Rotation.from_rotvec(t * np.array(spin)).apply(body.position - 0.5) for t in time]
    target = np.array(turned) + np.outer(time, (0.3, 1.0, -0.2))[:, None]
    target += 0.5 * np.square(time)[:, None, None] * np.array(settings.gravity)
    target[1:] += 2e-4 * np.random.default_rng(2).standard_normal(target[1:].shape)
    own = np.arange(27)[:, None], np.ones((27, 1))
    state = (body.position, body.volume, None, {})
    return Observation("flight", "elasticity", settings, time, target, *own, *state, **fields)


@pytest.mark.filterwarnings("ignore:`torch.jit.script` is deprecated:DeprecationWarning")
def test_a_rigid_free_flight_gives_back_its_spin_and_says_that_it_tells_no_stiffness() -> None:
    spin = (3.0, 6.0, -4.5)
    for gradient in (True, False):
        observation = flight(spin, spins_have_gradient=gradient)
        unknowns = unknowns_of(observation, fixed={"poissons_ratio": 0.3}, motion=True)
        problem = problem_of(observation, unknowns)
        guess = with_first_motion(observation, unknowns, np.array([3e5, *[0.0] * 6]))
        u, at = solved(problem, guess.tolist(), iterations=4)
        stiffness, *motion = uncertainty(at, unknowns, u, ROUNDING).estimates
        within = [
            low < true < high for (low, high), true in zip([one.interval for one in motion[3:]], spin, strict=True)
        ]
        assert all(within) is gradient, motion
        if gradient:
            assert not stiffness.identifiable
