"""GNS: symmetries of the graph network, what it is trained on, and a training that the clock ends."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from training_bodies import EVERY, SETTINGS, STEPS, recorded, starts

from pcnclaws.baselines.gns import GraphNetworkSimulator, gns
from pcnclaws.baselines.graphs import MOST_NEIGHBOURS, graph_of, neighbours, wall_distances
from pcnclaws.baselines.windows import FRAMES, Windows, before_start, random_walk, walls_alone
from pcnclaws.data.datamodule import CheckedDataModule
from pcnclaws.errors import SimulationDiverged, UserError
from pcnclaws.evaluation.tasks import evaluate_records
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.mpm.colliders import Collider
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.simulation.execution import Execution
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.training.budget import WallClock
from pcnclaws.training.one_step import OneStepModule
from pcnclaws.training.trainer import fit, quiet_lightning

RADIUS = 0.13
WALLS = ((0.1, 0.1, 0.1), (0.9, 0.9, 0.9))
SMALL = {"width": 8, "message_passing_steps": 2, "radius": RADIUS}


def simulator(seed: int = 0) -> GraphNetworkSimulator:
    """A small simulator in double precision with random weights and the units of small bodies."""
    torch.manual_seed(seed)
    model = gns(MATERIALS["elasticity"], SMALL).double()
    with torch.no_grad():
        for weight in model.parameters():
            weight += 0.1 * torch.randn_like(weight)
    model.frame_time.fill_(EVERY * SETTINGS.time_step)
    model.velocity_unit.fill_(5e-3)
    model.change_unit.fill_(1e-4)
    return model


def cloud(count: int = 60) -> np.ndarray:
    """Particles about the middle of the domain, farther from all walls than these are seen."""
    return 0.5 + 0.2 * (np.random.default_rng(1).random((count, 3)) - 0.5)


def changes(model: GraphNetworkSimulator, history: np.ndarray) -> torch.Tensor:
    parameters = torch.tensor([0.2, -0.3], dtype=torch.float64)
    return model.network(graph_of(torch.from_numpy(history), WALLS, parameters, model.velocity_unit, RADIUS))


def moving(position: np.ndarray) -> np.ndarray:
    steps = 1e-3 * np.random.default_rng(2).standard_normal((FRAMES - 1, *position.shape))
    return np.concatenate((position[None], position + steps.cumsum(0)))


def test_neighbours_are_all_pairs_within_the_radius() -> None:
    position = cloud()
    senders, receivers = neighbours(position, 0.08)
    distance = np.linalg.norm(position[:, None] - position[None], axis=2)
    expected = {(i, j) for i, j in zip(*np.nonzero(distance < 0.08), strict=True) if i != j}
    assert set(zip(senders.tolist(), receivers.tolist(), strict=True)) == expected
    crowd = 0.5 + 1e-3 * np.random.default_rng(3).random((200, 3))
    assert np.bincount(neighbours(crowd, RADIUS)[1]).max() == MOST_NEIGHBOURS
    assert neighbours(position[:1], RADIUS)[0].size == 0


def test_walls_are_seen_only_nearby() -> None:
    seen = wall_distances(torch.tensor([[0.5, 0.15, 0.88]], dtype=torch.float64), WALLS)
    assert seen[0].tolist() == pytest.approx([1.0, 0.5, 1.0, 1.0, 1.0, 0.2])


def test_walls_are_those_of_the_domain_and_what_else_stands_there_is_refused() -> None:
    settings = SimulationSettings(domain=((0.0, 0.0, 0.0), (2.0, 1.0, 1.0)))
    seen = wall_distances(torch.tensor([[1.85, 0.5, 0.5]], dtype=torch.float64), walls_alone(settings, "x"))
    assert seen[0].tolist() == pytest.approx([1.0, 1.0, 1.0, 0.5, 1.0, 1.0])
    unbounded = walls_alone(SimulationSettings(domain=None), "x")
    assert wall_distances(torch.zeros(1, 3, dtype=torch.float64), unbounded)[0].tolist() == [1.0] * 6
    plane = Collider.plane(point=(0.0, 0.2, 0.0), normal=(0.0, 1.0, 0.0))
    with pytest.raises(UserError, match="x has colliders or loads, which model=gns does not see; accepted: bodies"):
        walls_alone(SimulationSettings(colliders=(plane,)), "x")


def test_away_from_walls_the_network_does_not_know_where_it_is() -> None:
    model, history = simulator(), moving(cloud())
    shift = np.array([0.05, -0.1, 0.02])
    torch.testing.assert_close(changes(model, history + shift), changes(model, history))


def test_near_a_wall_it_does() -> None:
    model, history = simulator(), moving(cloud())
    assert (changes(model, history - np.array([0.0, 0.3, 0.0])) - changes(model, history)).abs().max() > 1e-3


def test_the_order_of_the_particles_does_not_matter() -> None:
    model, history = simulator(), moving(cloud())
    order = np.random.default_rng(4).permutation(history.shape[1])
    torch.testing.assert_close(changes(model, history[:, order]), changes(model, history)[order])


def test_the_noise_is_a_random_walk_of_the_velocity() -> None:
    noise = random_walk(np.random.default_rng(5), 3e-4, (FRAMES, 20_000, 3))
    velocity = np.diff(noise, axis=0)
    assert not noise[0].any()
    for n, of_frame in enumerate(velocity, start=1):
        assert of_frame.std() == pytest.approx(3e-4 * math.sqrt(n / 5.0), rel=0.02)
        assert abs(of_frame.mean()) < 1e-5
    increments = np.diff(velocity, axis=0)
    assert abs(np.corrcoef(increments[0].ravel(), increments[1].ravel())[0, 1]) < 0.02


def test_the_frames_before_a_start_are_free_flight() -> None:
    start = starts(1)[0]
    later = replace(start, settings=SimulationSettings(time_step=1e-3), position=start.position + 0.3)
    model, frame = gns(MATERIALS["elasticity"], SMALL), 5e-3
    before = before_start(later, frame)
    assert before.shape == (FRAMES - 1, 64, 3)
    dt, gravity = 1e-3, np.array(later.settings.gravity)
    position, velocity = before[0], later.velocity - 25 * dt * gravity
    for n in range(1, 26):  # the steps of the simulation from the first of them
        velocity = velocity + dt * gravity
        position = position + dt * velocity
        if n % 5 == 0 and n < 25:
            np.testing.assert_allclose(position, before[n // 5], atol=1e-12)
    np.testing.assert_allclose(position, later.position, atol=1e-12)
    assert model.parameter_names == ("youngs_modulus", "poissons_ratio")


def test_an_untrained_simulator_keeps_the_velocity() -> None:
    bodies = recorded(1)
    model = gns(MATERIALS["elasticity"], SMALL)
    model.windows(bodies, 1, 1, 1e-5, 0)
    run = model.simulate([starts(1)[0]], FramePlan(STEPS, EVERY))[0]
    last = run.position[1] - run.position[0]
    np.testing.assert_allclose(np.diff(run.position, axis=0), np.broadcast_to(last, (8, 64, 3)), atol=1e-6)
    np.testing.assert_allclose(run.time, bodies[0].time)


def test_without_noise_the_true_change_leads_to_the_next_frame() -> None:
    bodies = recorded(2)
    model = gns(MATERIALS["elasticity"], SMALL)
    data = model.windows(bodies, 40, 2, 0.0, 7)
    batch = data[3]
    assert isinstance(batch, Windows)
    assert batch.change.shape == (128, 3)
    again = model.windows(bodies, 40, 2, 0.0, 7)[3]
    assert torch.equal(batch.change, again.change)
    assert torch.equal(batch.graph.nodes, again.graph.nodes)
    squares = torch.cat([data[k].change for k in range(40)]).square().mean()
    assert float(squares.sqrt()) == pytest.approx(model.change_unit.item(), rel=0.3)
    assert not torch.equal(batch.change, data[4].change)


def test_a_simulation_has_the_precision_asked_for_and_leaves_the_simulator_as_it_is() -> None:
    model, done = simulator(), list[int]()
    before = {name: weight.clone() for name, weight in model.state_dict().items()}
    finer = replace(starts(1)[0], settings=replace(SETTINGS, grid_spacing=1 / 32))
    scenes, plan = [starts(1)[0], finer], FramePlan(4 * EVERY, EVERY)
    single = model.simulate(scenes, plan, Execution(progress=done.append))
    assert sum(done) == 2 * plan.steps  # as the simulator by laws counts scenes of two settings
    double = model.simulate(scenes, plan, Execution(torch.float64))
    assert (single[0].position.dtype, double[0].position.dtype) == (np.float32, np.float64)
    np.testing.assert_allclose(single[0].position, double[0].position, atol=1e-5)
    after = model.state_dict()
    assert all(weight.dtype == torch.float64 and torch.equal(weight, before[name]) for name, weight in after.items())


def trained(folder: Path, bodies: list[SceneRecord], iterations: int, budget: float | None = None) -> OneStepModule:
    quiet_lightning()
    torch.manual_seed(0)
    model, clock = gns(MATERIALS["elasticity"], SMALL | {"width": 16}), WallClock(budget)
    data = CheckedDataModule(model.windows(bodies, iterations, 1, 1e-5, 0), iterations, bodies, 50)
    module = OneStepModule(model, 3e-3, 1.0, iterations, clock)
    fit(module, data, folder, torch.device("cpu"), clock=clock)
    return module


@pytest.mark.slow
def test_a_short_training_lowers_the_error_and_is_evaluated_as_a_law_is(tmp_path: Path) -> None:
    bodies = recorded(1)
    module = trained(tmp_path, bodies, 300)
    untrained = gns(MATERIALS["elasticity"], SMALL)
    untrained.windows(bodies, 1, 1, 1e-5, 0)
    before, after = (evaluate_records(bodies, model)[0] for model in (untrained, module.model))
    assert after.mse < 0.6 * before.mse
    assert after.stress_error is None
    assert after.energy_error is None
    assert after.seconds is not None
    assert after.seconds > 0.0


def test_the_clock_ends_a_training_at_a_check_and_a_restart_adds_nothing(tmp_path: Path) -> None:
    bodies = recorded(1)
    module = trained(tmp_path, bodies, 10_000, budget=0.5)
    spent, reached = module.clock.spent, module.trainer.global_step
    assert spent >= 0.5
    assert reached < 10_000
    assert reached % 50 == 0
    again = trained(tmp_path, bodies, 10_000, budget=0.5)
    assert again.trainer.global_step == reached
    assert again.clock.spent == pytest.approx(spent, abs=2.0)


def test_what_it_cannot_do_is_said_in_one_line() -> None:
    model = simulator()
    with pytest.raises(UserError, match=r"frames 0\.002 s apart are not accepted.*multiples of 0\.005 s"):
        model.simulate([starts(1)[0]], FramePlan(4, 2))
    model.change_unit.fill_(math.inf)
    with pytest.raises(SimulationDiverged, match="scene 'body_0' diverged"):
        model.simulate([starts(1)[0]], FramePlan(STEPS, EVERY))
    with pytest.raises(UserError, match=r"model\.width=0"):
        gns(MATERIALS["sand"], SMALL | {"width": 0})
    record = recorded(1)[0]
    tiled = {"position": np.tile(record.position, (1, 40, 1)), "volume": np.tile(record.volume, 40)}
    many = replace(record, **tiled, initial_velocity=None, keyframes=None)
    with pytest.raises(UserError, match="trains on at most 2000"):
        simulator().windows([many], 1, 1, 0.0, 0)
