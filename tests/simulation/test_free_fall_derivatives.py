"""Derivatives of a run that takes no step before contact are those of all steps."""

import pytest
import torch
from falling_bodies import OFF, ON, Bodies, analytic, batch, body, neural, three_falls
from torch import Tensor
from torch.autograd import forward_ad

from pcnclaws.laws.materials import MATERIALS
from pcnclaws.simulation.fast_paths import Skips
from pcnclaws.simulation.free_fall import free_steps
from pcnclaws.simulation.rollout import differentiable_rollout
from pcnclaws.simulation.simulator import Simulator

# PyTorch warns of its own use of torch.jit when it loads forward mode
pytestmark = pytest.mark.filterwarnings("ignore:`torch.jit.script` is deprecated:DeprecationWarning")

STEPS = 100
FALLING = body((0.5, 0.6, 0.5), (0.3, -1.0, 0.0))


def falls(simulator: Simulator, bodies: Bodies) -> list[int]:
    return free_steps(simulator, *bodies[:3], STEPS)


def gradients(simulator: Simulator, bodies: Bodies, skips: Skips, recompute: bool, steps: int = STEPS) -> list[Tensor]:
    """Positions, and the gradients of positions, parameters and weights."""
    start = bodies.state.position.clone().requires_grad_()
    parameters = {name: value.clone().requires_grad_() for name, value in bodies.parameters.items()}
    moved = bodies._replace(state=bodies.state._replace(position=start), parameters=parameters)
    found = differentiable_rollout(simulator, moved, steps, every=10, recompute=recompute, skips=skips)
    wanted = [start, *parameters.values(), *simulator.parameters()]
    return [found.detach(), *torch.autograd.grad((found - 0.4).square().sum(), wanted)]


@pytest.mark.parametrize("law", ["analytic", "neural"])
@pytest.mark.parametrize("material", list(MATERIALS))
def test_gradients_are_those_of_all_steps(material: str, law: str) -> None:
    made = analytic(material) if law == "analytic" else neural(material)
    bodies = three_falls(material)
    for a, b in zip(gradients(made, bodies, ON, True), gradients(made, bodies, OFF, False), strict=True):
        assert b.abs().max() > 0.0
        torch.testing.assert_close(a, b, rtol=1e-9, atol=1e-9 * float(b.abs().max()))


def test_a_velocity_that_is_differentiated_takes_every_step() -> None:
    bodies = batch(FALLING)
    asked = bodies._replace(state=FALLING._replace(velocity=FALLING.velocity.clone().requires_grad_()))
    assert falls(analytic(), asked) == [0]
    with torch.no_grad():
        assert falls(analytic(), asked) == falls(analytic(), bodies)
    with forward_ad.dual_level():
        dual = forward_ad.make_dual(FALLING.velocity, torch.ones_like(FALLING.velocity))
        assert falls(analytic(), bodies._replace(state=FALLING._replace(velocity=dual))) == [0]


def test_tangents_are_those_of_all_steps() -> None:
    state, scenes, parameters, _ = batch(body((0.5, 0.35, 0.5), (0.3, -2.5, 0.1)))
    assert 0 < falls(analytic(), Bodies(state, scenes, parameters))[0] < 30
    stiffness = parameters["youngs_modulus"]

    def tangent(skips: Skips, functional: bool) -> Tensor:
        def positions(value: Tensor) -> Tensor:
            values = parameters | {"youngs_modulus": value}
            return differentiable_rollout(
                analytic(), Bodies(state, scenes, values), 40, 10, recompute=False, skips=skips
            )

        if functional:
            return torch.func.jvp(positions, (stiffness,), (stiffness,))[1]
        with forward_ad.dual_level():
            found = forward_ad.unpack_dual(positions(forward_ad.make_dual(stiffness, stiffness))).tangent
        assert found is not None
        return found

    every_step = tangent(OFF, True)
    assert every_step.abs().max() > 1e-6
    for functional in (True, False):
        torch.testing.assert_close(tangent(ON, functional), every_step, rtol=1e-9, atol=1e-12)


def test_a_rollout_that_never_meets_anything_has_gradients_all_the_same() -> None:
    _, position, *others = gradients(neural("sand"), batch(FALLING, material="sand"), ON, True, steps=20)
    assert position.abs().max() > 0.0
    assert all(bool((gradient.abs() < 1e-12).all()) for gradient in others)
