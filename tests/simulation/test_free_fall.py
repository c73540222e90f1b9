"""Before its first contact a body without stress and spin needs no step, and nobody can tell that it took none."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from bodies import in_precision
from falling_bodies import (
    OFF,
    ON,
    PARTICLES,
    SETTINGS,
    Bodies,
    analytic,
    batch,
    body,
    neural,
    run,
    same,
    simulator,
    three_falls,
)
from torch import nn

from pcnclaws.errors import SimulationDiverged
from pcnclaws.laws.analytic import Laws
from pcnclaws.laws.base import Elasticity, Plasticity
from pcnclaws.laws.elasticity import FixedCorotated
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.mpm.contact import VERSION_1_STICK
from pcnclaws.mpm.state import ParticleState
from pcnclaws.simulation.fast_paths import Skips
from pcnclaws.simulation.free_fall import free_steps
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.rollout import simulate_scenes
from pcnclaws.simulation.simulator import Simulator
from pcnclaws.tensors.linalg3 import identity_like
from pcnclaws.tensors.tensor_types import Matrices, Parameters

STEPS = 100
PLAN = FramePlan(STEPS, every=7, keyframe_every=30, velocities=True)
FALLING = body((0.5, 0.6, 0.5), (0.3, -1.0, 0.0))


def falls(simulator: Simulator, bodies: Bodies, steps: int = STEPS) -> list[int]:
    return free_steps(simulator, *bodies[:3], steps)


@pytest.mark.parametrize("material", list(MATERIALS))
def test_scenes_that_meet_the_floor_at_different_times_move_as_if_every_step_was_taken(material: str) -> None:
    bodies, simulator = three_falls(material), analytic(material)
    early, late, never = falls(simulator, bodies)
    assert 0 < early < late < never == STEPS
    assert same(run(simulator, bodies, PLAN), run(simulator, bodies, PLAN, OFF), 1e-11)


def test_each_scene_moves_as_if_it_was_alone() -> None:
    simulator, whole = analytic("sand"), run(analytic("sand"), three_falls("sand"), PLAN)
    for k in range(3):
        part = slice(k * PARTICLES, (k + 1) * PARTICLES)
        alone = batch(ParticleState(*(field[..., part] for field in three_falls().state)), material="sand")
        torch.testing.assert_close(run(simulator, alone, PLAN).position, whole.position[..., part], atol=1e-13, rtol=0)


def test_single_precision_differs_by_its_rounding() -> None:
    state, scenes, parameters, _ = three_falls()
    single = {name: value.float() for name, value in parameters.items()}
    bodies = Bodies(in_precision(state, torch.float32), in_precision(scenes, torch.float32), single)
    skipped, full = (run(analytic().float(), bodies, PLAN, skips) for skips in (ON, OFF))
    torch.testing.assert_close(skipped.position, full.position, atol=3e-6, rtol=0)


@pytest.mark.parametrize("boundary", ["separate", VERSION_1_STICK, "slip", "sticky"])
@pytest.mark.parametrize("side", [(axis, sign) for axis in range(3) for sign in (-1.0, 1.0)])
def test_contact_with_any_wall_ends_the_free_fall(side: tuple[int, float], boundary: str) -> None:
    axis, sign = side
    velocity, gravity = np.array((0.4, 0.0, -0.3)), np.zeros(3)
    velocity[axis], gravity[axis] = 3.0 * sign, 9.8 * sign
    bodies = batch(body((0.5, 0.5, 0.5), velocity), gravity=[gravity])
    simulator = analytic(settings=replace(SETTINGS, boundary=boundary))
    (steps,) = falls(simulator, bodies)
    assert 40 < steps < STEPS
    plan = FramePlan(STEPS, keyframe_every=1, velocities=True)
    full = run(simulator, bodies, plan, OFF)
    assert same(run(simulator, bodies, plan), full, 1e-11)
    strain = (full.deformation - identity_like(full.deformation[0])).abs().amax((1, 2, 3))
    assert strain[: steps + 1].max() < 1e-12 < strain[steps + 5], "contact comes when it is said to come"


def test_without_gravity_a_body_flies_and_one_that_leaves_a_wall_is_not_held_by_it() -> None:
    weightless = [(0.0, 0.0, 0.0)] * 3
    low = 0.1 + 0.5 * 0.2
    still, leaving = body((0.5, low, 0.5), (0.0, 0.0, 0.0)), body((low, low, 0.5), (0.2, 1.0, 0.0))
    bodies = batch(FALLING, still, leaving, gravity=weightless)
    assert falls(analytic(), bodies) == [STEPS] * 3
    assert same(run(analytic(), bodies, PLAN), run(analytic(), bodies, PLAN, OFF), 1e-11)


def test_a_body_thrown_upwards_turns_and_falls_as_it_would() -> None:
    bodies = batch(body((0.5, 0.4, 0.5), (0.0, 0.3, 0.0)))
    assert 90 < falls(analytic(), bodies, 300)[0] < 300
    plan = FramePlan(300, every=10, velocities=True)
    assert same(run(analytic(), bodies, plan), run(analytic(), bodies, plan, OFF), 1e-11)


class Prestressed(FixedCorotated):
    """A law of a body that is never free of stress."""

    def kirchhoff_stress(self, deformation: Matrices, parameters: Parameters) -> Matrices:
        return super().kirchhoff_stress(deformation, parameters) + 10.0 * identity_like(deformation)


class Flowing(Plasticity):
    """Plastic flow that needs no stress."""

    parameter_names = ()

    def return_map(self, trial: Matrices, parameters: Parameters) -> Matrices:
        return trial * (1.0 - 1e-6)


class StillAtZeroWeight(Elasticity):
    """No stress at rest, but only for this one weight."""

    parameter_names = ("youngs_modulus",)

    def __init__(self) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.zeros(()))

    def kirchhoff_stress(self, deformation: Matrices, parameters: Parameters) -> Matrices:
        return self.weight * parameters["youngs_modulus"] * identity_like(deformation).expand_as(deformation)


def test_laws_that_move_a_body_at_rest_are_always_evaluated() -> None:
    bodies = batch(FALLING)
    for laws in (Laws(Prestressed(), None), Laws(FixedCorotated(), Flowing()), Laws(StillAtZeroWeight(), None)):
        assert falls(simulator(laws), bodies) == [0]
    for model in ("pcnclaws", "pcnclaws_no_prior", "pcnclaws_paper"):
        assert falls(neural("elasticity", model), bodies)[0] > 0


def changed(field: str, value: float, particle: int = 5) -> ParticleState:
    """The falling body with one number of one particle changed."""
    tensor = getattr(FALLING, field).clone()
    tensor[(0,) * (tensor.ndim - 1) + (particle,)] += value
    return FALLING._replace(**{field: tensor})


@pytest.mark.parametrize("field", ["velocity", "affine", "deformation"])
@pytest.mark.parametrize("value", [1e-12, float("nan")])
def test_a_body_that_does_not_start_as_one_takes_every_step(field: str, value: float) -> None:
    assert falls(analytic(), batch(FALLING, changed(field, value))) == [falls(analytic(), batch(FALLING))[0], 0]


def test_positions_outside_the_domain_or_unknown_are_left_to_the_report() -> None:
    for value in (float("nan"), 2.0):
        with pytest.raises(SimulationDiverged, match=r"scene '1' diverged at step 0: particle 5"):
            run(analytic(), batch(FALLING, changed("position", value)), PLAN)


@pytest.mark.parametrize("skips", [ON, OFF])
def test_a_body_that_flies_out_of_the_domain_is_named_while_others_fall(skips: Skips) -> None:
    wild = body((0.5, 0.3, 0.5), (0.0, 400.0, 0.0))
    wild.position[1, 7] = 0.65
    bodies = batch(FALLING, wild, FALLING)
    with pytest.raises(SimulationDiverged, match=r"scene 'wild' diverged at step 1: particle 7: it left the domain"):
        simulate_scenes(analytic(), bodies._replace(names=("a", "wild", "b")), PLAN, skips)


def test_progress_counts_the_steps_that_were_not_needed() -> None:
    told: list[int] = []
    simulate_scenes(analytic(), three_falls(), PLAN, progress=told.append)
    assert sum(told) == STEPS
    assert max(told) > 1
