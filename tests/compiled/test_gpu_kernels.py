"""The kernels for GPUs against those of the CPU.

The same sources, once on a GPU, and once on the CPU, their threads one after the other, so that no GPU is needed.
"""

import pytest
import torch
from bodies import seeded, uniform
from compiled_checks import (
    MATERIALS,
    Batch,
    in_dtype,
    kernel_of,
    largest_difference,
    moving_batch,
    network_of,
    simulator_of,
)
from torch import Tensor

from pcnclaws.compiled import gpu
from pcnclaws.compiled.backend import using_backend
from pcnclaws.compiled.build import find_compiler
from pcnclaws.compiled.isotropic_laws import isotropic_law
from pcnclaws.compiled.structures import Corners, LawArrays
from pcnclaws.laws.elasticity import FixedCorotated, StVKHencky
from pcnclaws.laws.law import Law
from pcnclaws.mpm.contact import VERSION_1_STICK
from pcnclaws.mpm.integrator import MPMIntegrator
from pcnclaws.mpm.settings import UNIT_BOX, SimulationSettings
from pcnclaws.simulation.physical_states import failing_particles

pytestmark = pytest.mark.skipif(find_compiler() is None, reason="needs a C++ compiler")
ON_GPU = [pytest.mark.gpu, pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")]
DEVICES = pytest.mark.parametrize("device", ["cpu", pytest.param("cuda", marks=ON_GPU)])
PRECISIONS = pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float64, 1e-11), (torch.float32, 5e-6)])


@DEVICES
@PRECISIONS
@pytest.mark.parametrize("kind", ["analytic", "neural", "free flow", "no prior"])
@pytest.mark.parametrize("material", MATERIALS)
def test_laws_and_their_gradients(material: str, kind: str, dtype: torch.dtype, tolerance: float, device: str) -> None:
    simulator, batch = simulator_of(material, kind).to(dtype), in_dtype(moving_batch(material), dtype)
    laws = [law for law in (simulator.elasticity, simulator.plasticity) if law is not None]
    for law in laws:
        found, expected = _of_gpu_source(law, batch, device), _of_cpu(law, batch)
        assert len(found) == len(expected)
        assert largest_difference(found, expected) < tolerance


@DEVICES
@pytest.mark.parametrize("width", [1, 7, 130])
def test_networks_of_any_width(width: int, device: str) -> None:
    law, batch = simulator_of("plasticine", "neural", width=width).plasticity, moving_batch("plasticine")
    assert law is not None
    assert largest_difference(_of_gpu_source(law, batch, device), _of_cpu(law, batch)) < 1e-11


@DEVICES
@pytest.mark.parametrize("particles", [600, 20_000])
def test_gradients_of_weights_are_summed_over_all_particles(particles: int, device: str) -> None:
    law, batch = simulator_of("sand", "neural", width=8).plasticity, moving_batch("sand", (particles - 5, 5))
    assert law is not None
    assert largest_difference(_of_gpu_source(law, batch, device), _of_cpu(law, batch)) < 1e-11


def test_gradients_that_nobody_wants_change_no_other() -> None:
    law, batch = simulator_of("sand", "neural").plasticity, moving_batch("sand")
    assert law is not None
    assert law.kernel is not None
    rows, weights, incoming = _inputs(law, batch)
    given = law.kernel, LawArrays(batch.state.deformation, rows, None, weights), (incoming, None)
    both, one = (gpu.law_adjoint(*given, wanted) for wanted in ((True, True), (False, False)))
    assert torch.equal(one.deformation, both.deformation)
    assert (one.parameters, one.weights) == (None, [])


@DEVICES
@PRECISIONS
@pytest.mark.parametrize(
    ("boundary", "transfer"),
    [("separate", "apic"), (VERSION_1_STICK, "apic"), ("slip", "axpic2"), ("sticky", "apic"), ("separate", "axpic4")],
)
def test_a_step_and_its_gradients(
    boundary: str, transfer: str, dtype: torch.dtype, tolerance: float, device: str
) -> None:
    state, scenes, _ = in_dtype(moving_batch("sand", (40, 5, 20)), dtype)
    integrator = MPMIntegrator(SimulationSettings(grid_spacing=1 / 10, boundary=boundary, transfer=transfer))
    stress = 100.0 * uniform(seeded(1), 3, 3, state.position.shape[1]).to(dtype)
    inputs = [field.clone().requires_grad_() for field in (*state[:4], stress)]
    after = integrator(type(state)(*inputs[:4]), inputs[4], scenes)[:4]
    incoming = tuple(uniform(seeded(2), *field.shape).to(dtype) for field in after)
    expected = [*after, *torch.autograd.grad(after, inputs, incoming)]

    settings = integrator.kernel_settings(integrator.grid)
    bodies = tuple(field.to(device) for field in scenes[:4])
    fields = tuple(field.detach().to(device) for field in inputs)
    step = gpu.StepInput(settings, bodies, fields)
    found, nodes = gpu.step_forward(step)
    gradients = gpu.step_adjoint(step, nodes, found[1], found[2], tuple(field.to(device) for field in incoming))
    assert largest_difference([field.cpu() for field in (*found, *gradients)], expected) < tolerance


def test_parameters_and_networks_that_do_not_fit_are_refused() -> None:
    law, batch = simulator_of("sand", "neural").elasticity, moving_batch("sand")
    rows, weights, _ = _inputs(law, batch)
    plastic = simulator_of("sand", "neural").plasticity
    assert plastic is not None
    for other, given, network, refused in (
        (law, rows[:1], weights, "reads 3 rows of parameters"),
        (plastic, rows, weights, "reads 4 rows of parameters"),
        (FixedCorotated(), rows, [], "reads 2 rows of parameters"),
        (law, rows, [], "the network must fit"),
    ):
        with pytest.raises((RuntimeError, ValueError), match=refused):
            gpu.law_forward(kernel_of(other), LawArrays(batch.state.deformation, given, None, network))
    with pytest.raises(ValueError, match="float64 on cpu was given torch.float32 on cpu"):
        gpu.law_forward(kernel_of(StVKHencky()), LawArrays(batch.state.deformation, rows[:2].float()))


@DEVICES
def test_particles_that_have_gone_wrong(device: str) -> None:
    state = moving_batch("sand").state
    state.position[0, 1], state.position[1, 2], state.deformation[1, :, 6] = -1e-6, float("nan"), 0.0
    with using_backend("torch"):
        expected = failing_particles(state)
    assert expected.sum() == 3
    found = gpu.failing(state.position.to(device), state.deformation.to(device), Corners.of(UNIT_BOX))
    assert torch.equal(found.cpu(), expected)


def _of_gpu_source(law: Law, batch: Batch, device: str) -> list[Tensor]:
    """The result, and gradients of deformation, parameters and weights."""
    rows, weights, incoming = _inputs(law, batch)
    assert law.kernel is not None
    weights = [weight.to(device) for weight in weights]
    given = LawArrays(batch.state.deformation.to(device), rows.to(device), None, weights)
    gradients = gpu.law_adjoint(law.kernel, given, (incoming.to(device), None), (True, True))
    assert gradients.parameters is not None
    found = [gpu.law_forward(law.kernel, given)[0], gradients.deformation, gradients.parameters, *gradients.weights]
    return [tensor.cpu() for tensor in found]


def _of_cpu(law: Law, batch: Batch) -> list[Tensor]:
    rows, weights, incoming = _inputs(law, batch)
    assert law.kernel is not None
    inputs = [tensor.clone().requires_grad_() for tensor in (batch.state.deformation, rows, *weights)]
    result, _ = isotropic_law(law.kernel, LawArrays(inputs[0], inputs[1], None, inputs[2:]))
    return [result.detach(), *torch.autograd.grad(result, inputs, incoming)]


def _inputs(law: Law, batch: Batch) -> tuple[Tensor, list[Tensor], Tensor]:
    rows = law.kernel_rows(batch.parameters).contiguous()
    weights = [weight.detach() for weight in (network_of(law).all_weights if "network" in law._modules else ())]
    return rows, weights, uniform(seeded(5), *batch.state.deformation.shape).to(rows.dtype)
