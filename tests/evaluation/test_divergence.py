"""A simulation that leaves the physical world stops, and says where."""

import pytest
import torch
from bodies import joined
from small_scene import small_body, small_scene, step_of

from pcnclaws.errors import SimulationDiverged
from pcnclaws.mpm.state import ParticleState, Scenes
from pcnclaws.simulation.rollout import simulate


def two_scenes(second: ParticleState) -> tuple[ParticleState, Scenes]:
    """A harmless scene and another one in a batch."""
    scene = small_scene()
    scenes = Scenes(
        torch.cat((scene.scene_index, scene.scene_index + 1)),
        scene.mass.repeat(2),
        scene.volume.repeat(2),
        scene.gravity.repeat(1, 2),
    )
    return joined(small_body(height=0.5, velocity=(0.0, 0.0, 0.0)), second), scenes


def divergence_of(second: ParticleState, steps: int, every: int, material: str = "elasticity", **how: float) -> str:
    state, scenes = two_scenes(second)
    step = step_of(material, scenes, **how)
    with pytest.raises(SimulationDiverged) as failure:
        simulate(step, state, scenes, steps, every, scene_names=("good", "bad"), advice="the advice")
    message = str(failure.value)
    assert "\n" not in message
    assert "'bad'" in message
    assert message.endswith("the advice")
    return message


@pytest.mark.parametrize("every", [1, 5, 30])
def test_leaving_the_domain_names_scene_step_and_particle(every: int) -> None:
    body = small_body()
    # 500 m/s upwards: 0.25 m in every step of 5e-4 s, through the ceiling in the second one
    body.velocity[:] = torch.tensor([[0.0], [500.0], [0.0]])
    body.position[1, :] = 0.3
    body.position[1, 5] = 0.6
    message = divergence_of(body, 30, every, youngs_modulus=1e-3)
    assert "step 2:" in message
    assert "particle 5:" in message
    assert "left the domain" in message


@pytest.mark.parametrize("every", [1, 7])
def test_a_deformation_turned_inside_out_names_scene_step_and_particle(every: int) -> None:
    body = small_body()
    # an affine velocity that compresses by more than the whole thickness in one step
    body.velocity[:] = -4000.0 * (body.position - body.position.mean(1, keepdim=True))
    message = divergence_of(body, 20, every, youngs_modulus=1e-3)
    assert "step 1:" in message
    assert "det F" in message


def test_a_divergence_that_does_not_come_back_is_told_all_the_same() -> None:
    """As on a GPU, where two runs differ by rounding: the search for its step ends."""
    state, scenes = two_scenes(small_body())
    steps = 0

    def step(before: ParticleState, step: int = 0) -> ParticleState:
        nonlocal steps
        steps += 1
        beyond = before.position.clone()
        beyond[0, -1] = -1e-8 if steps == 3 else 0.5
        return before._replace(position=beyond)

    with pytest.raises(SimulationDiverged, match="'bad' diverged at step 5: particle .* by no more than rounding"):
        simulate(step, state, scenes, 10, 5, scene_names=("good", "bad"))


@pytest.mark.parametrize("field", ["position", "velocity", "affine", "deformation"])
def test_a_state_that_is_not_a_number_is_found_wherever_it_begins(field: str) -> None:
    body = small_body()
    getattr(body, field)[..., 3] = float("nan")
    assert "not finite" in divergence_of(body, 20, 4)


def test_too_large_a_time_step_stops_the_run_instead_of_filling_it_with_nan() -> None:
    scene = small_scene()
    with pytest.raises(SimulationDiverged, match=r"scene '0' diverged at step \d+: particle \d+: "):
        simulate(step_of("elasticity", scene, time_step=8e-3), small_body(), scene, 500, every=50)
