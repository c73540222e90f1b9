"""The compiled kernels against the PyTorch reference: the step, its derivatives in both modes, and its corners."""

import math

import pytest
import torch
from bodies import per_particle, principal, seeded, uniform
from compiled_checks import (
    MATERIALS,
    after_steps,
    gradients,
    in_dtype,
    kernel_of,
    largest_difference,
    laws_of,
    moving_batch,
    rates,
    simulator_of,
)
from law_checks import rotations
from torch.autograd import forward_ad

from pcnclaws.compiled.backend import using_backend
from pcnclaws.compiled.build import find_compiler
from pcnclaws.compiled.calls import kernels_serve
from pcnclaws.compiled.isotropic_laws import isotropic_law
from pcnclaws.compiled.structures import LawArrays
from pcnclaws.laws.elasticity import StVKHencky
from pcnclaws.laws.materials import material_named
from pcnclaws.laws.plasticity import DruckerPrager
from pcnclaws.mpm.colliders import Collider
from pcnclaws.mpm.contact import VERSION_1_STICK
from pcnclaws.mpm.integrator import MPMIntegrator
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.simulation.physical_states import failing_particles
from pcnclaws.simulation.simulator import Simulator
from pcnclaws.tensors.linalg3 import exp_symmetric, matmul
from pcnclaws.tensors.tensor_types import Matrices, Parameters

pytestmark = [
    pytest.mark.skipif(find_compiler() is None, reason="needs a C++ compiler"),
    pytest.mark.filterwarnings("ignore:`torch.jit.script` is deprecated:DeprecationWarning"),
]
BOTH = pytest.mark.parametrize("kind", ["analytic", "neural"])
# kernels of each are compiled for it, which takes seconds
DEAR = [pytest.param(kind, marks=pytest.mark.slow) for kind in ("free flow", "no prior")]
EVERY = pytest.mark.parametrize("kind", ["analytic", "neural", *DEAR])
EACH = pytest.mark.parametrize("material", MATERIALS)


@EVERY
@EACH
def test_states_and_derivatives_in_both_modes_equal_those_of_pytorch(material: str, kind: str) -> None:
    simulator, batch = simulator_of(material, kind), moving_batch(material)
    found = {}
    for backend in ("torch", "compiled"):
        with using_backend(backend):
            assert kernels_serve(batch.state.position) == (backend == "compiled")
            found[backend] = [
                *after_steps(simulator, batch),
                *gradients(simulator, batch),
                *rates(simulator, batch),
            ]
    assert largest_difference(found["compiled"], found["torch"]) < 1e-11


@EVERY
@EACH
def test_single_precision_is_as_right_as_that_of_pytorch(material: str, kind: str) -> None:
    simulator, batch = simulator_of(material, kind), moving_batch(material)
    expected = after_steps(simulator, batch)
    errors = {}
    for backend in ("torch", "compiled"):
        with using_backend(backend):
            single = after_steps(simulator.float(), in_dtype(batch, torch.float32))
            errors[backend] = largest_difference(single, expected)
        simulator.double()
    assert errors["compiled"] < max(2.0 * errors["torch"], 1e-6)


@pytest.mark.parametrize("width", [1, 7, 40, 130])
def test_networks_of_any_width(width: int) -> None:
    simulator, batch = simulator_of("plasticine", "neural", width=width), moving_batch("plasticine")
    found = [*after_steps(simulator, batch), *gradients(simulator, batch)]
    with using_backend("torch"):
        expected = [*after_steps(simulator, batch), *gradients(simulator, batch)]
    assert largest_difference(found, expected) < 1e-11


def test_sticking_walls() -> None:
    simulator, batch = simulator_of("sand", "analytic", VERSION_1_STICK), moving_batch("sand")
    found = [*after_steps(simulator, batch), *gradients(simulator, batch), *rates(simulator, batch)]
    with using_backend("torch"):
        expected = [*after_steps(simulator, batch), *gradients(simulator, batch), *rates(simulator, batch)]
    assert largest_difference(found, expected) < 1e-11


@pytest.mark.parametrize("transfer", ["axpic2", "axpic3", "axpic4"])
def test_affine_xpic_and_its_derivatives_in_both_modes_equal_those_of_pytorch(transfer: str) -> None:
    simulator, batch = simulator_of("elasticity", "analytic", transfer=transfer), moving_batch("elasticity")
    found = [*after_steps(simulator, batch), *gradients(simulator, batch), *rates(simulator, batch)]
    with using_backend("torch"):
        expected = [*after_steps(simulator, batch), *gradients(simulator, batch), *rates(simulator, batch)]
    assert largest_difference(found, expected) < 1e-11


@pytest.mark.parametrize("transfer", ["axpic2", "axpic3"])
def test_affine_xpic_with_a_collider_equals_that_of_pytorch(transfer: str) -> None:
    """The grid between the kernels is computed in PyTorch there."""
    collider = Collider.plane((0.0, 0.25, 0.0), (0.2, 1.0, 0.0), friction=0.3)
    settings = SimulationSettings(transfer=transfer, colliders=(collider,))
    laws, batch = laws_of("elasticity", "analytic"), moving_batch("elasticity")
    simulator = Simulator(laws.elasticity, laws.plasticity, MPMIntegrator(settings)).double()
    found = [*after_steps(simulator, batch), *gradients(simulator, batch), *rates(simulator, batch)]
    with using_backend("torch"):
        expected = [*after_steps(simulator, batch), *gradients(simulator, batch), *rates(simulator, batch)]
    assert largest_difference(found, expected) < 1e-11


@BOTH
def test_the_number_of_threads_changes_no_bit(kind: str) -> None:
    transfer = "axpic3" if kind == "analytic" else "apic"
    simulator, batch = simulator_of("sand", kind, transfer=transfer), moving_batch("sand", (3000, 40))
    alone = [*after_steps(simulator, batch), *gradients(simulator, batch)]
    torch.set_num_threads(2)
    try:
        together = [*after_steps(simulator, batch), *gradients(simulator, batch)]
    finally:
        torch.set_num_threads(1)
    assert all(torch.equal(a, b) for a, b in zip(alone, together, strict=True))


def test_the_window_of_the_grid_changes_no_bit() -> None:
    batch = moving_batch("sand")
    window = [*after_steps(s := simulator_of("sand", "analytic"), batch), *gradients(s, batch)]
    whole = [*after_steps(s := simulator_of("sand", "analytic", window=False), batch), *gradients(s, batch)]
    assert all(torch.equal(a, b) for a, b in zip(window, whole, strict=True))


@BOTH
def test_a_diverged_scene_disturbs_no_other(kind: str) -> None:
    simulator, batch = simulator_of("sand", kind), moving_batch("sand")
    healthy = after_steps(simulator, batch)
    broken = batch.state._replace(position=batch.state.position.clone(), deformation=batch.state.deformation.clone())
    of_first = batch.scenes.scene_index == 0
    broken.position[:, 0] = torch.tensor([float("nan"), 1e30, -float("inf")])
    broken.deformation[:, :, 1] = float("nan")
    broken.deformation[:, :, 2] = 0.0
    after = after_steps(simulator, batch._replace(state=broken))
    assert all(torch.equal(a[..., ~of_first], b[..., ~of_first]) for a, b in zip(after, healthy, strict=True))
    assert not bool(torch.isfinite(after.position[:, of_first]).all())


def test_inside_of_the_yield_surface_nothing_changes_by_a_bit() -> None:
    strain = principal(-0.02, -0.021, -0.0205)
    trial = matmul(rotations(1, 50), exp_symmetric(strain).expand(3, 3, 50).contiguous())
    parameters = per_particle(material_named("sand").defaults, 50)
    assert torch.equal(DruckerPrager()(trial, parameters), trial)


def test_extreme_stretches_keep_their_digits() -> None:
    stretches = [(20.0, 0.05, 0.05), (20.0, 20.0, 0.05), (0.05, 1.0, 20.0), (1.0, 1.0, 1.0 + 1e-9)]
    stretches += [(3e9, 2e9, 1e9), (1e-9, 3e-9, 2e-9)]  # squares at the ends of single precision
    diagonal = torch.diag_embed(torch.tensor(stretches).double()).permute(1, 2, 0)
    count = len(stretches)
    q = rotations(2, count)
    f = matmul(matmul(q, diagonal), rotations(3, count))
    # mu = 1/2 and lambda = 0: the stress is the Hencky strain
    parameters = per_particle({"youngs_modulus": 1.0, "poissons_ratio": 0.0}, count)
    logarithms = diagonal.where(diagonal == 0.0, diagonal.log())
    exact = matmul(matmul(q, logarithms), q.transpose(0, 1))
    torch.testing.assert_close(StVKHencky()(f, parameters), exact, rtol=0, atol=2e-12)


def test_gradient_of_the_laws_where_stretches_meet() -> None:
    """Equal, nearly equal and just distinguishable stretches: the divided difference and its limit agree."""
    gaps = torch.tensor([0.0, 1e-12, 1e-9, 1e-7, 1e-6, 5e-6, 2e-5, 1e-4, 1e-3]).double()
    strain = torch.diag_embed(torch.stack((0.1 + gaps, 0.1 - gaps, torch.full_like(gaps, -0.3)), 1)).permute(1, 2, 0)
    f = matmul(matmul(rotations(4, len(gaps)), exp_symmetric(strain)), rotations(5, len(gaps)))
    simulator = simulator_of("plasticine", "neural")
    parameters = per_particle(material_named("plasticine").defaults, len(gaps))
    found = []
    for backend in ("torch", "compiled"):
        with using_backend(backend):
            inputs = f.clone().requires_grad_()
            assert simulator.plasticity is not None
            after = simulator.plasticity(inputs, parameters)
            stress = simulator.elasticity(inputs, parameters)
            scalar = (after * uniform(seeded(6), *f.shape)).sum() + 1e-5 * (stress * uniform(seeded(7), *f.shape)).sum()
            found.append(torch.autograd.grad(scalar, inputs)[0])
    torch.testing.assert_close(found[1], found[0], rtol=1e-8, atol=1e-8)


def test_a_law_derived_from_another_runs_its_own_equations() -> None:
    class Softer(StVKHencky):
        def kirchhoff_stress(self, deformation: Matrices, parameters: Parameters) -> Matrices:
            return 0.5 * super().kirchhoff_stress(deformation, parameters)

    batch = moving_batch("sand")
    stress = StVKHencky()(batch.state.deformation, batch.parameters)
    torch.testing.assert_close(Softer()(batch.state.deformation, batch.parameters), 0.5 * stress)


def test_gradients_that_are_expanded_or_summed() -> None:
    batch = moving_batch("sand")
    found = []
    for backend in ("torch", "compiled"):
        with using_backend(backend):
            f = batch.state.deformation.clone().requires_grad_()
            stress = StVKHencky()(f, batch.parameters)
            found.append(torch.autograd.grad(stress.sum(), f)[0])
    torch.testing.assert_close(found[1], found[0])


@pytest.mark.parametrize("size", [1e-2, 1e-4, 1e-6])
@EACH
def test_gradients_at_small_strains(material: str, size: float) -> None:
    """Where stretches nearly coincide, in both precisions, for bodies that flow."""
    generator = seeded(9)
    f = torch.eye(3).double()[:, :, None] + size * (uniform(generator, 3, 3, 200) - 0.7 * torch.eye(3)[:, :, None])
    simulator = simulator_of(material, "analytic")
    values = {"youngs_modulus": 1.0, "poissons_ratio": 0.3, "yield_stress": 0.1 * size, "friction_angle": 10.0}
    names = material_named(material).parameter_names
    parameters = per_particle({name: values[name] for name in names}, 200)
    weight = uniform(generator, 3, 3, 200)
    for dtype, tolerance in ((torch.float64, 1e-5), (torch.float32, 1e-4)):
        found = []
        for backend in ("torch", "compiled"):
            with using_backend(backend):
                inputs = f.to(dtype).requires_grad_()
                numbers = {name: value.to(dtype) for name, value in parameters.items()}
                laws = (simulator.elasticity, simulator.plasticity)
                results = [(law(inputs, numbers) * weight.to(dtype)).sum() for law in laws if law is not None]
                found.append(torch.autograd.grad(results, inputs)[0])
        # float32 sees the yield surface elsewhere: a few particles are on its other side
        difference = (found[1] - found[0]).abs().amax((0, 1)) / found[0].abs().max()
        assert float(difference.double().quantile(0.97 if dtype == torch.float32 else 1.0)) < tolerance


def test_a_result_that_nobody_looks_at_has_the_same_gradients() -> None:
    simulator, batch = simulator_of("sand", "neural"), moving_batch("sand")
    found = []
    for evaluated in (True, False):
        state = batch.state._replace(deformation=batch.state.deformation.clone().requires_grad_())
        after = simulator(state, batch.scenes, batch.parameters, evaluated)
        incoming = [uniform(seeded(8), *field.shape) for field in after[:4]]
        found.append(torch.autograd.grad(after[:4], [state.deformation, *simulator.parameters()], incoming))
        assert torch.equal(after.deformation, after_steps(simulator, batch, 1).deformation) == evaluated
    assert all(torch.equal(a, b) for a, b in zip(*found, strict=True))


def test_second_derivatives_are_refused_and_mixed_modes_run_in_pytorch() -> None:
    batch = moving_batch("sand")
    f = batch.state.deformation.clone().requires_grad_()
    (gradient,) = torch.autograd.grad(StVKHencky()(f, batch.parameters).square().sum(), f, retain_graph=True)
    with pytest.raises(RuntimeError, match="simulation.backend=torch"):
        torch.autograd.grad(StVKHencky()(f, batch.parameters).square().sum(), f, create_graph=True)
    with forward_ad.dual_level():
        dual = forward_ad.make_dual(f, torch.ones_like(f))
        energy = StVKHencky()(dual, batch.parameters).square().sum()
        (slope,) = torch.autograd.grad(energy, dual, create_graph=True)
        assert forward_ad.unpack_dual(slope).tangent is not None
        torch.testing.assert_close(forward_ad.unpack_dual(slope).primal, gradient)


def test_a_body_turned_inside_out_is_not_a_number() -> None:
    batch = moving_batch("sand")
    f = batch.state.deformation.clone()
    f[0, :, 1] *= -1.0
    f[0, :, 2] = 0.0
    simulator = simulator_of("sand", "analytic")
    for law in (simulator.elasticity, simulator.plasticity):
        assert law is not None
        result = law(f, batch.parameters)
        assert not bool(torch.isfinite(result[..., 1:3]).any())
        assert bool(torch.isfinite(result[..., 3:]).all())


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_particles_that_have_gone_wrong_are_those_of_pytorch(dtype: torch.dtype) -> None:
    state = in_dtype(moving_batch("sand"), dtype).state
    state.position[0, 1], state.position[1, 2], state.position[2, 3] = -1e-6, 1.0 + 1e-6, math.nan
    state.position[:, 4] = torch.tensor([0.0, 1.0, 0.5])  # just inside
    state.deformation[0, :, 5] *= -1.0
    state.deformation[1, :, 6] = 0.0
    state.deformation[2, 2, 7], state.position[0, 8], state.deformation[0, 0, 9] = math.nan, math.inf, -math.inf
    found = []
    for backend in ("torch", "compiled"):
        with using_backend(backend):
            found.append(failing_particles(state).nonzero()[:, 0].tolist())
    assert found == [[1, 2, 3, 5, 6, 7, 8, 9]] * 2


def test_input_that_does_not_fit_is_refused_or_broadcast() -> None:
    simulator, (state, scenes, parameters) = simulator_of("sand", "analytic"), moving_batch("sand")
    stress = simulator.elasticity(state.deformation, parameters)
    with pytest.raises(ValueError, match="scene_index"):
        simulator.integrator(state, stress, scenes._replace(scene_index=scenes.scene_index.flip(0)))
    with pytest.raises(ValueError, match="scene_index"):
        simulator.integrator(state, stress, scenes._replace(gravity=scenes.gravity[:, :2]))
    ones = torch.ones(400, len(scenes.mass)).double()
    with pytest.raises(ValueError, match="rows of parameters"):
        isotropic_law(kernel_of(DruckerPrager()), LawArrays(state.deformation, ones))
    elastic = laws_of("sand", "neural").elasticity
    with pytest.raises(ValueError, match="rows of parameters"):
        isotropic_law(kernel_of(elastic), LawArrays(state.deformation, ones[:3]))
    single = {name: torch.full_like(value, 0.3) for name, value in parameters.items()}
    broadcast = {name: value[:1] for name, value in single.items()}
    found = simulator.elasticity.kernel_rows(broadcast).expand(-1, len(scenes.mass))
    law = simulator.elasticity
    given = LawArrays(state.deformation, found)
    torch.testing.assert_close(isotropic_law(kernel_of(law), given)[0], law(state.deformation, single))


def test_what_the_kernels_cannot_differentiate_runs_in_pytorch() -> None:
    simulator, batch = simulator_of("elasticity", "analytic"), moving_batch("elasticity")
    mass = batch.scenes.mass.clone().requires_grad_()
    assert not kernels_serve(batch.state.position, constants=(mass,))
    after = simulator(batch.state, batch.scenes._replace(mass=mass), batch.parameters)
    (gradient,) = torch.autograd.grad(after.position.square().sum(), mass)
    assert bool(gradient.abs().max() > 0.0)

    def stress(f: torch.Tensor) -> torch.Tensor:
        return simulator.elasticity(f, batch.parameters)

    f = batch.state.deformation
    by_transform = torch.func.jvp(stress, (f,), (torch.ones_like(f),))[1]
    step = 1e-6
    by_difference = (stress(f + step) - stress(f - step)) / (2 * step)
    torch.testing.assert_close(by_transform, by_difference, rtol=1e-6, atol=1e-3)
