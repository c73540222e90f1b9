"""Levenberg-Marquardt for plastic amounts: their derivatives, no step that leads away, and what steps do not find."""

from collections.abc import Mapping
from dataclasses import replace
from io import StringIO
from pathlib import Path

import pytest
import torch
from rich.console import Console
from torch import Tensor
from training_bodies import EVERY, STEPS, starts

from benchmarks.foreign_materials import CappedDruckerPrager
from pcnclaws.data.datamodule import TrajectoryDataModule
from pcnclaws.data.segments import SegmentPlan
from pcnclaws.errors import UserError
from pcnclaws.laws.analytic import Laws, analytic_laws
from pcnclaws.laws.elasticity import StVKHencky
from pcnclaws.laws.materials import MATERIALS, Material
from pcnclaws.laws.neural import build_neural_laws
from pcnclaws.laws.neural_convex import LIMITS
from pcnclaws.laws.plasticity import DruckerPrager
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.training.levenberg_marquardt import LevenbergMarquardtModule
from pcnclaws.training.module import OptimiserSettings
from pcnclaws.training.trainer import fit

pytestmark = pytest.mark.filterwarnings("ignore:`torch.jit.script` is deprecated:DeprecationWarning")
TRESCA = MATERIALS["tresca"]


def moved(material: Material, laws: Laws, values: Mapping[str, float]) -> list[SceneRecord]:
    """Motions of three bodies that land, positions alone; their last parameter grows from body to body."""
    begun = [
        replace(
            start,
            material=material.name,
            parameters={**start.parameters, **{name: value * (1.0 + 0.25 * k) for name, value in values.items()}},
        )
        for k, start in enumerate(starts(3))
    ]
    found = simulate_records(begun, laws, FramePlan(STEPS, EVERY, 0))
    return [replace(record, keyframes=None, velocity=None) for record in found]


@pytest.fixture(scope="module")
def records() -> list[SceneRecord]:
    return moved(TRESCA, analytic_laws(TRESCA), {"yield_stress": 100.0})


def module_and_data(
    records: list[SceneRecord], iterations: int = 4, material: Material = TRESCA, network: str = "pcnclaws_convex"
) -> tuple[LevenbergMarquardtModule, TrajectoryDataModule]:
    laws = build_neural_laws(material, {"name": network})
    plan = SegmentPlan(iterations, 3, "initial", first=STEPS, last=STEPS)
    data = TrajectoryDataModule(records, records, plan, iterations // 2, torch.float64)
    return LevenbergMarquardtModule(laws, data.dataset.settings, OptimiserSettings(), iterations), data


def test_derivatives_by_the_amounts_are_those_of_differences(records: list[SceneRecord]) -> None:
    module, data = module_and_data(records)
    batch, now = data.dataset[0], module._amounts.weight.detach().clone()
    derivatives = module._derivatives(batch, now, module._positions_with(batch, now))

    def end(amount: int, change: float) -> Tensor:
        other = now.clone()
        other[amount, 0] += change
        return module._positions_with(batch, other)

    for k in (2, 6, 9):  # cohesion, the round share, the direction of flow
        difference = (end(k, 1e-6) - end(k, -1e-6)) / 2e-6
        assert difference.abs().max() > 1e-6
        torch.testing.assert_close(derivatives[k], difference, rtol=1e-3, atol=1e-3 * float(difference.abs().max()))
    assert torch.equal(module._amounts.weight, now)


@pytest.mark.slow
def test_a_surface_with_corners_is_found_and_the_elastic_law_stays(records: list[SceneRecord], tmp_path: Path) -> None:
    module, data = module_and_data(records, 6)
    before = module.checked(records).mse
    elastic = [weight.clone() for weight in module.laws.elasticity.parameters()]
    found = fit(module, data, tmp_path, torch.device("cpu"), console=Console(file=StringIO()))
    assert found.best.mse < 1e-4 * before
    assert all(torch.equal(*pair) for pair in zip(elastic, module.laws.elasticity.parameters(), strict=True))


def test_a_step_lowers_the_misfit_and_one_that_would_not_is_not_taken(records: list[SceneRecord]) -> None:
    module, data = module_and_data(records)
    batch, now = data.dataset[0], module._amounts.weight.detach().clone()
    here = module._positions_with(batch, now)
    there = module._stepped(batch, now, here)
    assert module._misfit(batch, there, module._positions_with(batch, there)) < module._misfit(batch, now, here)
    # positions of the law itself: nothing is better
    assert torch.equal(module._stepped(batch._replace(target=here), now, here), now)


@pytest.mark.parametrize("capped", [True, False])
def test_a_bound_on_compression_that_nothing_reaches_is_found_by_a_jump(capped: bool) -> None:
    """Soft bodies with friction, whose pressure the first of them bears up to tr h = -0.02, the others all of it."""
    law = CappedDruckerPrager() if capped else DruckerPrager()
    records = moved(MATERIALS["sand"], Laws(StVKHencky(), law), {"friction_angle": 22.0})
    module, data = module_and_data(records, material=MATERIALS["sand"])
    batch, now = data.dataset[0], module._amounts.weight.detach().clone()
    here = module._positions_with(batch, now)
    found, there = module._jumped(batch, now, here)
    assert module._misfit(batch, found, there) <= module._misfit(batch, now, here)
    changed = (found != now).any(1).nonzero().flatten().tolist()
    assert changed == ([LIMITS.index("compression")] if capped else [])


def test_a_stored_energy_is_found_too() -> None:
    """Neo-Hookean bodies, whose law is among the sums of the energy net."""
    material = MATERIALS["neo_hookean"]
    records = moved(material, analytic_laws(material), {})
    module, data = module_and_data(records, material=material, network="pcnclaws_energy")
    batch, now = data.dataset[0], module._amounts.weight.detach().clone()
    here = module._positions_with(batch, now)
    there = module._positions_with(batch, module._stepped(batch, now, here))
    assert (there - batch.target).square().mean() < 0.1 * (here - batch.target).square().mean()


@pytest.mark.parametrize(("material", "network"), [("sand", "pcnclaws_energy"), ("elasticity", "pcnclaws")])
def test_laws_without_amounts_are_refused(material: str, network: str, records: list[SceneRecord]) -> None:
    laws = build_neural_laws(MATERIALS[material], {"name": network})
    with pytest.raises(UserError, match=r"training.method=levenberg_marquardt .* accepted: model=pcnclaws_convex"):
        LevenbergMarquardtModule(laws, [records[0].settings], OptimiserSettings(), 1)
