"""Laws that remember, laws that take time, and viscous ones: as kernels, in motion, in files and as derivatives."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from bodies import per_particle, seeded, uniform
from compiled_checks import Batch, after_steps, gradients, largest_difference, moving_batch, rates
from torch import Tensor

import pcnclaws as pc
from benchmarks.remembering_material import CLAY, PUTTY, HardeningVonMises, Relaxing, SofteningHencky
from pcnclaws.compiled import gpu
from pcnclaws.compiled.backend import using_backend
from pcnclaws.compiled.build import find_compiler
from pcnclaws.compiled.structures import LawArrays
from pcnclaws.data.hdf5 import read_scenes, write_scenes
from pcnclaws.errors import UserError
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.fixed_parameters import FixedParameters
from pcnclaws.laws.internal_variables import start_values
from pcnclaws.laws.law import Law
from pcnclaws.laws.materials import Material
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.simulation.fast_paths import Skips
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.scenes import SceneStart, restarted
from pcnclaws.simulation.simulator import Simulator, simulator_of

# PyTorch warns of its own use of torch.jit when it loads forward mode
pytestmark = pytest.mark.filterwarnings("ignore:`torch.jit.script` is deprecated:DeprecationWarning")
COMPILED = pytest.mark.skipif(find_compiler() is None, reason="needs a C++ compiler")
MATERIALS = pytest.mark.parametrize("material", [CLAY, PUTTY], ids=["clay", "putty"])
MODULUS, RATIO = 2e5, 0.25
SETTINGS = SimulationSettings(grid_spacing=0.1)


def _moving(material: Material) -> tuple[Simulator, Batch]:
    batch = moving_batch("sand", (40, 5))
    particles = batch.state.position.shape[1]
    simulator = simulator_of(analytic_laws(material), SETTINGS).double()
    internal = start_values(simulator.internal_variables, batch.state.position)
    internal = internal + 0.01 * uniform(seeded(9), *internal.shape, low=0.0, high=1.0)
    parameters = per_particle(material.defaults, particles)
    return simulator, Batch(batch.state._replace(internal=internal), batch.scenes, parameters)


@COMPILED
@MATERIALS
def test_kernels_agree_with_pytorch_in_the_motion_and_in_both_modes(material: Material) -> None:
    simulator, batch = _moving(material)
    assert all(law.kernel is not None for law in simulator.laws)
    found = []
    for backend in ("torch", "compiled"):
        with using_backend(backend):
            found.append([*after_steps(simulator, batch), *gradients(simulator, batch), *rates(simulator, batch)])
    assert float((found[0][4] - batch.state.internal).abs().max()) > 1e-5, "something is remembered"
    assert largest_difference(found[1], found[0]) < 1e-8


@COMPILED
@pytest.mark.parametrize("law", [HardeningVonMises(), Relaxing(), SofteningHencky()], ids=["hardens", "flows", "soft"])
def test_the_source_for_gpus_agrees(law: Law) -> None:
    simulator, batch = _moving(CLAY if isinstance(law, HardeningVonMises) else PUTTY)
    assert law.kernel is not None
    rows = law.kernel_rows(simulator.law_parameters(batch.parameters)).contiguous()
    f, internal = batch.state.deformation.contiguous(), batch.state.internal
    incoming = [uniform(seeded(2), *f.shape), uniform(seeded(3), *internal.shape)]
    inputs = [f.clone().requires_grad_(), rows.clone().requires_grad_(), internal.clone().requires_grad_()]
    result = law.answer(inputs[0], FixedParameters.of_rows({law: inputs[1]}), inputs[2])
    results = [one for one in result if one is not None and one.requires_grad and one is not inputs[2]]
    expected = [*results, *torch.autograd.grad(results, inputs, incoming[: len(results)])]
    given = LawArrays(f, rows, internal)
    found = [one for one in gpu.law_forward(law.kernel, given) if one is not None]
    back = gpu.law_adjoint(law.kernel, given, (incoming[0], incoming[1]), (True, True))
    assert back.parameters is not None
    assert back.internal is not None
    assert largest_difference([*found, back.deformation, back.parameters, back.internal], expected) < 1e-12


def test_hardening_in_simple_tension_follows_its_closed_form() -> None:
    """Loaded, unloaded and loaded again: the yield stress grows as tau_Y + H a, and unloading is elastic."""
    law = pc.analytic_law(CLAY)
    values = {"youngs_modulus": MODULUS, "poissons_ratio": RATIO, "yield_stress": 2e3, "hardening_modulus": 3e4}
    two_mu = MODULUS / (1.0 + RATIO)
    elastic, remembered = torch.eye(3, dtype=torch.float64), None
    direction = torch.tensor([2.0, -1.0, -1.0], dtype=torch.float64) / math.sqrt(6.0)  # |dev h| = 1
    total = plastic = 0.0
    for change in [0.004] * 10 + [-0.002] * 3 + [0.004] * 5:
        total += change
        stretch = torch.diag(torch.exp(change * direction))
        elastic, remembered = law.return_map(stretch @ elastic, internal=remembered, **values)
        reached = two_mu * (total - plastic)
        plastic += max(reached - 2e3 - 3e4 * plastic, 0.0) / (two_mu + 3e4)
        shear = law.stress(elastic, youngs_modulus=MODULUS, poissons_ratio=RATIO).diagonal() @ direction
        torch.testing.assert_close(float(shear), two_mu * (total - plastic), rtol=1e-12, atol=1e-9)
        torch.testing.assert_close(float(remembered[0]), plastic, rtol=1e-12, atol=0.0)
    assert law.internal_names == ("plastic_strain",)
    assert plastic > 0.03


def test_flow_that_takes_time_asks_for_it() -> None:
    law = pc.analytic_law(PUTTY)
    f = torch.diag(torch.tensor([1.1, 0.95, 1.0], dtype=torch.float64))
    half, _ = law.return_map(f, dt=0.05 * math.log(2.0), relaxation_time=0.05)
    dev = [one.log().diagonal() - one.log().diagonal().mean() for one in (f.diagonal().diag(), half.diagonal().diag())]
    torch.testing.assert_close(dev[1], 0.5 * dev[0])
    for wrong in (None, 0.0):
        with pytest.raises(UserError, match=f"dt={wrong} is not accepted; accepted: the time step"):
            law.return_map(f, dt=wrong, relaxation_time=0.05)
    with pytest.raises(UserError, match=r"internal is a tensor \(2,\); accepted: a tensor \(1,\), softness"):
        law.return_map(f, dt=0.1, internal=torch.ones(2), relaxation_time=0.05)


@pytest.mark.parametrize(
    ("given", "fault"),
    [
        ({"plastic_strian": 0.0}, "internal variable='plastic_strian' is not known.*did you mean 'plastic_strain'"),
        ({}, "flow gives no plastic_strain; accepted: plastic_strain"),
        (None, "flow gives list; accepted: three strains, and the internal variables by name"),
    ],
)
def test_flow_that_forgets_what_it_remembers_is_refused(given: dict[str, float] | None, fault: str) -> None:
    class Forgetful(HardeningVonMises):
        def flow(self, h: Any, p: Any) -> Any:
            return list(h) if given is None else (h, given)

    for backend in ("torch", "auto"):
        with using_backend(backend), pytest.raises(UserError, match=f"the law Forgetful.*{fault}"):
            pc.analytic_law(replace(CLAY, plastic=Forgetful)).return_map(torch.eye(3), **dict[str, Any](CLAY.defaults))


def _start(material: Material, name: str = "drop", height: float = 0.25) -> SceneStart:
    grid = np.stack(np.meshgrid(*[np.linspace(0.0, 0.3, 4)] * 3, indexing="ij"), -1).reshape(-1, 3)
    position = np.array([0.35, height, 0.35]) + grid
    velocity = np.tile([0.0, -3.0, 0.0], (64, 1))
    return SceneStart(name, material.name, SETTINGS, material.defaults, position, velocity, np.full(64, 1e-3))


@MATERIALS
def test_a_run_goes_on_from_a_restart_state_in_a_file_to_the_last_bit(material: Material, tmp_path: Path) -> None:
    laws, start = analytic_laws(material), _start(material)
    whole, first = (simulate_records([start], laws, FramePlan(n, 10, 40))[0] for n in (120, 80))
    write_scenes(tmp_path / "first.h5", [first])
    (read,) = read_scenes(tmp_path / "first.h5")
    assert read.keyframes is not None
    assert whole.keyframes is not None
    (remembered,) = read.keyframes.internal.values()
    assert np.ptp(remembered[-1]) > 1e-3
    again = simulate_records([restarted(start, read.keyframes, 2)], laws, FramePlan(40, 10, 40))[0]
    np.testing.assert_array_equal(again.position[-1], whole.position[-1])
    assert again.keyframes is not None
    for name, values in again.keyframes.internal.items():
        np.testing.assert_array_equal(values[-1], whole.keyframes.internal[name][-1])


@MATERIALS
def test_scenes_of_a_batch_are_as_alone_and_skipping_changes_no_more_than_rounding(material: Material) -> None:
    laws, plan = analytic_laws(material), FramePlan(100, 20, 100)
    starts = [_start(material), _start(material, "higher", 0.45)]
    execution = pc.simulation.execution.Execution(torch.float64)
    everything = replace(execution, skips=Skips(free_fall=False, rest=False, grid_window=False))
    together, plain = (simulate_records(starts, laws, plan, how) for how in (execution, everything))
    for k, start in enumerate(starts):
        (alone,) = simulate_records([start], laws, plan, execution)
        np.testing.assert_allclose(together[k].position, alone.position, atol=1e-12)
        np.testing.assert_allclose(together[k].position, plain[k].position, atol=1e-11)


@MATERIALS
@pytest.mark.parametrize("recompute", [False, True])
def test_gradients_through_an_impact_are_those_of_finite_differences(material: Material, recompute: bool) -> None:
    name = "hardening_modulus" if material is CLAY else "viscosity"
    batch = pc.simulation.batch.batch_scenes([_start(material, height=0.16)], torch.float64)
    simulator = simulator_of(analytic_laws(material), SETTINGS).double()

    def end(value: Tensor) -> Tensor:
        parameters = {**batch.parameters, name: value.expand(64)}
        moved = pc.simulation.rollout.positions_at(
            simulator, batch._replace(parameters=parameters), [60], recompute=recompute
        )
        return moved[-1].square().sum()

    value = torch.tensor(material.defaults[name], dtype=torch.float64, requires_grad=True)
    (slope,) = torch.autograd.grad(end(value), value)
    step = 1e-4 * value.detach()
    with torch.no_grad():
        difference = (end(value + step) - end(value - step)) / (2.0 * step)
    torch.testing.assert_close(slope, difference, rtol=2e-5, atol=0.0)
