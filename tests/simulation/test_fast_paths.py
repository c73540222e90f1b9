"""The switches: each one leaves the result as it is, and each one can be turned off from the command line."""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
import torch
from conftest import Outcome
from falling_bodies import OFF, ON, analytic, batch, body, neural, run
from recorded_scenes import recorded, small_cube

from pcnclaws.commands.composition import compose_config
from pcnclaws.commands.configuration import skips_from
from pcnclaws.commands.typed_configs import SimulateConfig
from pcnclaws.data.hdf5 import read_scenes
from pcnclaws.evaluation.tasks import evaluate_records
from pcnclaws.generate import generate
from pcnclaws.laws.analytic import Laws, analytic_laws
from pcnclaws.laws.base import Elasticity
from pcnclaws.laws.elasticity import FixedCorotated
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.simulate import simulate
from pcnclaws.simulation.execution import Execution
from pcnclaws.simulation.fast_paths import Skips
from pcnclaws.simulation.law_simulator import LawSimulator
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.rollout import differentiable_rollout
from pcnclaws.tensors.tensor_types import Matrices, Parameters
from pcnclaws.training.module import OptimiserSettings
from pcnclaws.training.multi_scene import MultiSceneModule

SWITCHES = [switch.name for switch in fields(Skips)]
LANDING = batch(body((0.5, 0.3, 0.5), (0.3, -2.0, 0.0)), body((0.5, 0.35, 0.5), (0.0, -2.0, 0.1)))
PLAN = FramePlan(40, every=4, keyframe_every=20)
# of one switch: those that change the order of additions, or what is computed, are not exact to the last bit
EXACT = {"history"}


@pytest.mark.parametrize("switch", [*SWITCHES, "all"])
def test_a_run_is_the_same_with_the_switch_off(switch: str) -> None:
    off = OFF if switch == "all" else replace(ON, **{switch: False})
    kept, computed = run(analytic(), LANDING, PLAN), run(analytic(), LANDING, PLAN, off)
    for a, b in ((kept.position, computed.position), (kept.deformation, computed.deformation)):
        torch.testing.assert_close(a, b, rtol=0.0, atol=0.0 if switch in EXACT else 1e-12)


@pytest.mark.parametrize("entry", ["simulate", "generate", "evaluate", "train"])
def test_the_switches_are_options_of_every_command_that_simulates(entry: str) -> None:
    assert skips_from(compose_config(entry).simulation) == Skips()
    assert skips_from(compose_config(entry, ["simulation.skip=none"]).simulation) == Skips.none()
    assert skips_from(compose_config(entry, ["simulation.skip=all"]).simulation) == Skips()
    for switch in SWITCHES:
        assert skips_from(compose_config(entry, [f"simulation.skip.{switch}=false"]).simulation) == replace(
            ON, **{switch: False}
        )
    only_rest = compose_config(entry, ["simulation.skip=none", "simulation.skip.rest=true"])
    assert skips_from(only_rest.simulation) == replace(OFF, rest=True)


@pytest.mark.parametrize(
    ("option", "line"),
    [
        ("simulation.skip=nothing", "simulation.skip='nothing' is not known; accepted: all, none"),
        ("simulation.skip=false", "simulation.skip='false' is not known; accepted: all, none"),
        ("simulation.skip=", "simulation.skip='' is not known; accepted: all, none"),
        ("+simulation.skip=nothing", "simulation.skip='nothing' is not known; accepted: all, none"),
        ("simulation.skip.rest=maybe", "simulation.skip.rest=maybe is not accepted; accepted: true or false"),
        (
            "simulation.skip.fall=true",
            "option='simulation.skip.fall' is not known; accepted: simulation.skip.free_fall",
        ),
        ("~simulation.skip.rest", "option 'simulation.skip.rest' is missing; accepted: true or false"),
    ],
)
def test_wrong_switches_are_refused_in_one_line(option: str, line: str, in_process) -> None:
    done: Outcome = in_process(_do_nothing, "simulate", option)
    assert (done.status, len(done.err.splitlines())) == (2, 1), done.err
    assert line in done.err


def test_a_sweep_can_compare_the_switches(in_process, tmp_path: Path) -> None:
    options = ("material=elasticity", "scene.particles_per_edge=4", "simulation.steps=10", "picture=false")
    done = in_process(simulate, "simulate", *options, "precision=float64", "--multirun", "simulation.skip=all,none")
    assert done.status == 0, done.err
    first, second = (read_scenes(path)[0] for path in sorted(tmp_path.rglob("*.h5")))
    np.testing.assert_allclose(first.position, second.position, atol=1e-7)
    assert first.velocity is not None
    assert second.velocity is not None
    np.testing.assert_allclose(first.velocity, second.velocity, atol=1e-6)


def test_data_does_not_depend_on_the_switches(in_process, tmp_path: Path) -> None:
    options = ("material=sand", "scene.particles_per_edge=3", "simulation.steps=20", "data.keyframe_every=10")
    few = ("data.train_scenes=1", "data.validation_scenes=1", "output=data")
    assert in_process(generate, "generate", *options, *few).status == 0
    files = {path: path.read_bytes() for path in tmp_path.rglob("*.h5")}
    assert in_process(generate, "generate", *options, *few, "simulation.skip=none").status == 0
    assert files == {path: path.read_bytes() for path in tmp_path.rglob("*.h5")}, "nothing is made anew"


def test_velocities_and_strains_are_kept_only_where_they_are_asked_for() -> None:
    cube = small_cube()
    laws = analytic_laws(MATERIALS["sand"])
    plain, asked = (simulate_records([cube], laws, FramePlan(20, 5, velocities=wanted))[0] for wanted in (False, True))
    assert plain.velocity is None
    assert plain.keyframes is None
    assert asked.velocity is not None
    assert asked.initial_velocity is not None
    np.testing.assert_array_equal(asked.velocity[0], asked.initial_velocity)
    everything = run(analytic(), LANDING, FramePlan(40, every=4), replace(ON, history=False))
    assert len(everything.velocity) == 11
    assert len(run(analytic(), LANDING, FramePlan(40, every=4)).velocity) == 0
    assert len(everything.deformation) == len(everything.keyframe_velocity) == 0, "kept, but not asked for"


def test_keyframes_are_full_states_without_velocities_at_the_frames() -> None:
    (record,), (with_velocity,) = (
        simulate_records([small_cube()], analytic_laws(MATERIALS["sand"]), FramePlan(20, 5, 10, velocities=wanted))
        for wanted in (False, True)
    )
    assert record.keyframes is not None
    assert with_velocity.velocity is not None
    np.testing.assert_array_equal(record.keyframes.velocity, with_velocity.velocity[::2])


class Listening(Elasticity):
    """Fixed corotated elasticity that remembers how often it was asked, and whether a graph was recorded."""

    parameter_names = ("youngs_modulus", "poissons_ratio")

    def __init__(self) -> None:
        super().__init__()
        self.recorded: list[bool] = []

    def kirchhoff_stress(self, deformation: Matrices, parameters: Parameters) -> Matrices:
        stress = FixedCorotated().kirchhoff_stress(deformation, parameters)
        self.recorded.append(stress.requires_grad)
        return stress

    def __deepcopy__(self, memo: dict) -> "Listening":
        return self


def test_the_checks_of_a_training_take_its_switches_and_record_no_graph() -> None:
    cube = small_cube(material="elasticity", velocity=(0.0, 0.5, 0.0))
    record = recorded(replace(cube, position=cube.position + np.array([0.0, 0.2, 0.0])), steps=10)[0]
    asked = {}
    for skips in (ON, OFF):
        law = Listening()
        module = MultiSceneModule(Laws(law, None), [record.settings], OptimiserSettings(), 1, skips)
        module.register_parameter("weight", torch.nn.Parameter(torch.zeros(())))
        assert module.checked([record]).mse < 1e-12
        asked[skips] = law.recorded.count(False)
        assert True not in law.recorded[-asked[skips] :]
    assert asked[OFF] == 10
    assert asked[ON] < 10, "a body in free flight takes no steps"


def test_frozen_weights_get_no_gradients() -> None:
    frozen = neural("elasticity").requires_grad_(False)
    stiffness = LANDING.parameters["youngs_modulus"].clone().requires_grad_()
    asked = LANDING._replace(parameters=LANDING.parameters | {"youngs_modulus": stiffness})
    (gradient,) = torch.autograd.grad(differentiable_rollout(frozen, asked, 40, 40).sum(), stiffness)
    assert gradient.abs().max() > 0.0
    assert not differentiable_rollout(frozen, LANDING, 5, 5).requires_grad
    assert all(weight.grad is None and not weight.requires_grad for weight in frozen.parameters())


def test_an_evaluation_is_the_same_with_the_switches_off() -> None:
    records = recorded(small_cube("a"), small_cube("b", velocity=(0.0, -1.0, 1.0)))
    model = LawSimulator(analytic_laws(MATERIALS["sand"]))
    kept, computed = (evaluate_records(records, model, Execution(torch.float64, skips=skips)) for skips in (ON, OFF))
    for a, b in zip(kept, computed, strict=True):
        np.testing.assert_allclose(a.predicted.position, b.predicted.position, atol=1e-7)


def _do_nothing(config: SimulateConfig) -> None:
    pass
