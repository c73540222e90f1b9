"""Recording and differentiation of many steps."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
import torch
from bodies import analytic_simulator, per_particle
from small_scene import PARTICLES, small_body, small_scene, step_of

from pcnclaws.laws.materials import MATERIALS
from pcnclaws.laws.neural import build_neural_laws
from pcnclaws.mpm.integrator import MPMIntegrator
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.mpm.state import ParticleState
from pcnclaws.simulation.batch import SceneBatch
from pcnclaws.simulation.rollout import differentiable_rollout, simulate
from pcnclaws.simulation.simulator import Simulator

pytestmark = pytest.mark.usefixtures("each_backend")


def test_frames_and_keyframes_are_the_states_of_a_plain_loop() -> None:
    scenes, state = small_scene(), small_body()
    step = step_of("sand", scenes)
    states = [state]
    for _ in range(12):
        states.append(step(states[-1]))
    run = simulate(step, state, scenes, 12, every=4, keyframe_every=6)
    assert run.step.tolist() == [0, 4, 6, 8, 12]
    assert run.keyframe_step.tolist() == [0, 6, 12]
    for frame, n in enumerate(run.step.tolist()):
        assert torch.equal(run.position[frame], states[n].position)
        assert torch.equal(run.velocity[frame], states[n].velocity)
    for frame, n in enumerate(run.keyframe_step.tolist()):
        assert torch.equal(run.affine[frame], states[n].affine)
        assert torch.equal(run.deformation[frame], states[n].deformation)


def test_a_run_continued_from_a_keyframe_is_the_same_run() -> None:
    scenes, step = small_scene(), step_of("sand", small_scene())
    run = simulate(step, small_body(), scenes, 20, every=5, keyframe_every=10)
    middle = ParticleState(run.position[2], run.velocity[2], run.affine[1], run.deformation[1])
    assert torch.equal(simulate(step, middle, scenes, 10, every=10).position[-1], run.position[-1])


def test_without_keyframes_none_are_kept_and_progress_is_told() -> None:
    scenes, steps = small_scene(), []
    run = simulate(step_of("elasticity", scenes), small_body(), scenes, 5, every=2, progress=steps.append)
    assert run.step.tolist() == [0, 2, 4]
    assert run.affine.shape == run.deformation.shape == (0, 3, 3, PARTICLES)
    assert sum(steps) == 5


def loss_and_gradients(material: str, recompute: bool) -> list[torch.Tensor]:
    scenes, body = small_scene(), small_body(height=0.2)
    fields = ParticleState(*(field.clone().requires_grad_() for field in body))
    values = per_particle(MATERIALS[material].defaults, PARTICLES)
    parameters = {name: value.requires_grad_() for name, value in values.items()}
    simulator = analytic_simulator(material, SimulationSettings())
    positions = differentiable_rollout(
        simulator, SceneBatch(fields, scenes, parameters), 12, every=6, recompute=recompute
    )
    assert positions.shape == (2, 3, PARTICLES)
    loss = (positions - 0.4).square().mean()
    return [loss, *torch.autograd.grad(loss, [*fields[:4], *parameters.values()])]


@pytest.mark.parametrize("material", list(MATERIALS))
def test_recomputed_gradients_equal_stored_ones(material: str) -> None:
    for recomputed, stored in zip(loss_and_gradients(material, True), loss_and_gradients(material, False), strict=True):
        assert torch.isfinite(stored).all()
        torch.testing.assert_close(recomputed, stored, rtol=1e-12, atol=1e-14 * float(stored.detach().abs().max()))


def test_weights_that_change_before_the_backward_pass_are_noticed() -> None:
    laws = build_neural_laws(MATERIALS["sand"], {"name": "pcnclaws", "width": 8})
    simulator = Simulator(*laws[:2], MPMIntegrator(SimulationSettings())).double()
    parameters = per_particle(MATERIALS["sand"].defaults, PARTICLES)
    for recompute in (True, False):
        positions = differentiable_rollout(
            simulator, SceneBatch(small_body(height=0.2), small_scene(), parameters), 3, recompute=recompute
        )
        with torch.no_grad():
            next(simulator.parameters()).mul_(1.5)
        with pytest.raises(RuntimeError, match="modified by an inplace operation"):
            positions.square().sum().backward()


def test_a_differentiable_rollout_goes_where_the_simulation_goes() -> None:
    scenes, state = small_scene(), small_body()
    simulator = analytic_simulator("plasticine", SimulationSettings())
    parameters = per_particle(MATERIALS["plasticine"].defaults, PARTICLES)
    step = simulator.step_function(scenes, parameters)
    positions = differentiable_rollout(simulator, SceneBatch(state, scenes, parameters), 20, every=5)
    assert torch.equal(positions, simulate(step, state, scenes, 20, every=5).position[1:])


@pytest.mark.parametrize("material", list(MATERIALS))
def test_the_gradient_of_a_rollout_with_contact_is_that_of_finite_differences(material: str) -> None:
    scenes, state = small_scene(), small_body(height=0.2)
    defaults = per_particle(MATERIALS[material].defaults, PARTICLES)

    def mean_height(log_factor: torch.Tensor) -> torch.Tensor:
        parameters = defaults | {"youngs_modulus": defaults["youngs_modulus"] * log_factor.exp()}
        simulator = analytic_simulator(material, SimulationSettings())
        return (
            1e3
            * differentiable_rollout(simulator, SceneBatch(state, scenes, parameters), 25, every=25)[0, 1]
            .square()
            .mean()
        )

    start = torch.zeros((), dtype=torch.float64, requires_grad=True)
    (gradient,) = torch.autograd.grad(mean_height(start), start)
    with torch.no_grad():
        difference = (mean_height(torch.tensor(1e-5).double()) - mean_height(torch.tensor(-1e-5).double())) / 2e-5
    assert gradient.abs() > 1e-6
    torch.testing.assert_close(gradient, difference, rtol=1e-4, atol=0)


LINUX = pytest.mark.skipif(sys.platform != "linux", reason="peak memory is read from /proc")
MEASURE_MEMORY = """
from pathlib import Path
import torch
from bodies import analytic_simulator, in_precision, one_scene, paper_cube, per_particle, spinning
from pcnclaws.compiled.backend import using_backend
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.mpm.state import ParticleState
from pcnclaws.simulation.batch import SceneBatch
from pcnclaws.simulation.rollout import differentiable_rollout

def peak():
    # not ru_maxrss: a new process takes over that of the process which started it
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0]) / 1024

torch.set_num_threads(1)
position = paper_cube()
velocity = spinning(position, (0.0, -1.0, 0.0), (0.0, 0.0, 2.0))
state = in_precision(ParticleState.at_rest_shape(position, velocity), torch.float32)
scenes = in_precision(one_scene(1000, 0.125 / 1000), torch.float32)
parameters = per_particle(MATERIALS["sand"].defaults, 1000, torch.float32)
parameters["youngs_modulus"].requires_grad_()
simulator = analytic_simulator("sand", SimulationSettings())


def roll(steps):
    positions = differentiable_rollout(simulator, SceneBatch(state, scenes, parameters), steps, every=5)
    positions.square().mean().backward()

with using_backend("{backend}"):
    roll(5)  # PyTorch and the kernels load what they need in their first step
    before = peak()
    roll({steps})
assert torch.isfinite(parameters["youngs_modulus"].grad).all()
print(peak() - before)
"""


def megabytes_of_a_rollout(steps: int, backend: str) -> float:
    """Peak memory of a forward and backward rollout of 1000 particles, above that of five steps [MiB]."""
    tests = Path(__file__).parents[1]
    script = MEASURE_MEMORY.replace("{steps}", str(steps)).replace("{backend}", backend)
    done = subprocess.run(
        [sys.executable, "-c", script],
        env=os.environ | {"PYTHONPATH": f"{tests}:{tests.parent}"},
        capture_output=True,
        text=True,
        check=True,
    )
    return float(done.stdout)


@LINUX
@pytest.mark.parametrize(
    ("each_backend", "most"),
    [pytest.param("torch", 75, marks=pytest.mark.slow), ("compiled", 10)],
    indirect=["each_backend"],
)
def test_the_memory_of_a_rollout_is_small(each_backend: str, most: int) -> None:
    assert 0 < megabytes_of_a_rollout(20, each_backend) <= most


@LINUX
@pytest.mark.slow
def test_the_memory_of_500_steps_forward_and_backward_is_within_its_budget(each_backend: str) -> None:
    megabytes = megabytes_of_a_rollout(500, each_backend)
    print(f"{megabytes:.0f} MiB")
    assert megabytes <= 600
