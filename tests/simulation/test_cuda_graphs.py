"""Steps on a GPU: recorded steps are the steps, with the same gradients, and nothing in them waits for the host."""

import pytest
import torch

from benchmarks.cases import Case, Prepared
from pcnclaws.compiled.backend import using_backend
from pcnclaws.errors import SimulationDiverged, UserError
from pcnclaws.mpm.state import ParticleState, Scenes
from pcnclaws.simulation.batch import SceneBatch
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.rollout import differentiable_rollout, simulate_scenes, state_after
from pcnclaws.simulation.simulator import Simulator

pytestmark = [
    pytest.mark.gpu,
    pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU"),
]


def prepared(material: str, laws: str, scenes: int = 2, device: str = "cuda") -> tuple[Simulator, SceneBatch]:
    """A simulator and scenes in contact, in double precision."""
    case = Prepared(Case(material, laws, scenes=scenes, particles_per_edge=6), torch.device("cpu"), 20)
    state, constants, parameters, names = case.batch
    batch = SceneBatch(
        ParticleState(*(field.to(device, torch.float64) for field in state)),
        Scenes(constants.scene_index.to(device), *(field.to(device, torch.float64) for field in constants[1:])),
        {name: values.to(device, torch.float64) for name, values in parameters.items()},
        names,
    )
    return case.simulator.to(device, torch.float64), batch


def gradients(simulator: Simulator, batch: SceneBatch, stiffer: float = 1.0) -> list[torch.Tensor]:
    """Positions, and gradients of the start velocity, the parameters and the weights."""
    velocity = batch.state.velocity.clone().requires_grad_()
    parameters = {name: values.clone().requires_grad_() for name, values in batch.parameters.items()}
    stiff = parameters | {"youngs_modulus": stiffer * parameters["youngs_modulus"]}
    asked = batch._replace(state=batch.state._replace(velocity=velocity), parameters=stiff)
    positions = differentiable_rollout(simulator, asked, 20, 5)
    weighted = (positions * torch.linspace(0.0, 1.0, positions.shape[-1]).to(positions)).sum()
    wanted = [velocity, *parameters.values(), *simulator.parameters()]
    return [positions.detach(), *torch.autograd.grad(weighted, wanted, materialize_grads=True)]


@pytest.mark.parametrize(
    ("material", "laws"), [("elasticity", "analytic"), ("plasticine", "neural"), ("sand", "neural")]
)
def test_recorded_simulation_equals_pytorch_and_the_cpu(material: str, laws: str) -> None:
    found = []
    for device, backend in (("cuda", "auto"), ("cuda", "torch"), ("cpu", "torch")):
        simulator, batch = prepared(material, laws, device=device)
        with using_backend(backend):
            trajectory = simulate_scenes(simulator, batch, FramePlan(60, 7, 20))
        found.append([field.cpu() for field in (trajectory.position, trajectory.deformation, trajectory.affine)])
    for other in found[1:]:
        for here, there in zip(found[0], other, strict=True):
            assert (here - there).abs().max() <= 1e-9 * there.abs().max()


def test_deterministic_algorithms_give_the_same_bits_twice() -> None:
    torch.use_deterministic_algorithms(True)
    try:
        simulator, batch = prepared("sand", "neural", scenes=8)
        first, second = gradients(simulator, batch), gradients(simulator, batch)
        with using_backend("compiled"), pytest.raises(UserError, match="adds up in another order in each run on a GPU"):
            gradients(simulator, batch)
    finally:
        torch.use_deterministic_algorithms(False)
    assert all(torch.equal(here, there) for here, there in zip(first, second, strict=True))


@pytest.mark.parametrize(("material", "laws"), [("elasticity", "analytic"), ("sand", "neural")])
def test_recorded_gradients_equal_pytorch_also_when_a_recording_is_used_again(material: str, laws: str) -> None:
    simulator, batch = prepared(material, laws)
    for stiffer in (1.0, 1.3):  # the second batch of the same shape goes through the first one's recording
        recorded = gradients(simulator, batch, stiffer)
        with using_backend("torch"):
            reference = gradients(simulator, batch, stiffer)
        for here, there in zip(recorded, reference, strict=True):
            assert (here - there).abs().max() <= 1e-8 * there.abs().max()


def test_batches_that_share_a_recording_keep_their_own_backward_pass() -> None:
    simulator, batch = prepared("elasticity", "analytic")
    alone = gradients(simulator, batch)
    parameters = {name: values.clone().requires_grad_() for name, values in batch.parameters.items()}
    velocity = batch.state.velocity.clone().requires_grad_()
    asked = batch._replace(state=batch.state._replace(velocity=velocity), parameters=parameters)
    positions = differentiable_rollout(simulator, asked, 20, 5)
    gradients(simulator, batch, 1.3)  # in between
    weighted = (positions * torch.linspace(0.0, 1.0, positions.shape[-1]).to(positions)).sum()
    found = torch.autograd.grad(weighted, [velocity, *parameters.values()])
    for here, there in zip(found, alone[1:], strict=True):
        assert (here - there).abs().max() <= 1e-8 * there.abs().max()


@pytest.mark.parametrize("backend", ["torch", "auto"])
def test_nothing_in_a_step_waits_for_the_host(backend: str) -> None:
    simulator, batch = prepared("sand", "neural")
    with using_backend(backend):
        after = state_after(simulator, batch, 10)  # records
        torch.cuda.synchronize()
        torch.cuda.set_sync_debug_mode("error")
        try:
            again = state_after(simulator, batch, 10)
        finally:
            torch.cuda.set_sync_debug_mode("default")
    assert (after.position - again.position).abs().max() <= 1e-9


def test_a_divergence_is_found_at_its_step() -> None:
    simulator, batch = prepared("elasticity", "analytic")
    fast = batch._replace(state=batch.state._replace(velocity=batch.state.velocity * 200.0))
    messages = []
    for backend in ("auto", "torch"):
        with using_backend(backend), pytest.raises(SimulationDiverged) as failure:
            simulate_scenes(simulator, fast, FramePlan(60, 20))
        messages.append(str(failure.value))
    assert messages[0] == messages[1]
    assert "diverged at step" in messages[0]
