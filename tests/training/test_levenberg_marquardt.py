"""Levenberg-Marquardt for plastic amounts: exact derivatives, no step that leads away, and a surface that is found."""

from dataclasses import replace
from io import StringIO
from pathlib import Path
from typing import cast

import pytest
import torch
from rich.console import Console
from torch import Tensor
from training_bodies import EVERY, STEPS, starts

from pcnclaws.data.datamodule import TrajectoryDataModule
from pcnclaws.data.segments import SegmentPlan
from pcnclaws.errors import UserError
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.laws.neural import build_neural_laws
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.simulation.rollout import differentiable_rollout
from pcnclaws.simulation.simulator import Simulator
from pcnclaws.training.levenberg_marquardt import LevenbergMarquardtModule
from pcnclaws.training.module import OptimiserSettings
from pcnclaws.training.trainer import fit

pytestmark = pytest.mark.filterwarnings("ignore:`torch.jit.script` is deprecated:DeprecationWarning")
TRESCA = MATERIALS["tresca"]


@pytest.fixture(scope="module")
def records() -> list[SceneRecord]:
    """Motions of Tresca bodies that land, positions alone."""
    begun = [
        replace(start, material="tresca", parameters={**start.parameters, "yield_stress": 600.0 + 150.0 * k})
        for k, start in enumerate(starts(3))
    ]
    found = simulate_records(begun, analytic_laws(TRESCA), FramePlan(STEPS, EVERY, 0))
    return [replace(record, keyframes=None, velocity=None) for record in found]


def module_and_data(
    records: list[SceneRecord], iterations: int = 4
) -> tuple[LevenbergMarquardtModule, TrajectoryDataModule]:
    laws = build_neural_laws(TRESCA, {"name": "pcnclaws_convex"})
    plan = SegmentPlan(iterations, 3, "initial", first=STEPS, last=STEPS)
    data = TrajectoryDataModule(records, records, plan, iterations // 2, torch.float64)
    return LevenbergMarquardtModule(laws, data.dataset.settings, OptimiserSettings(), iterations), data


def test_derivatives_by_the_amounts_are_those_of_differences(records: list[SceneRecord]) -> None:
    module, data = module_and_data(records)
    batch, weight = data.dataset[0], module._amounts.weight
    _, derivatives = module._linearised(batch)

    def end(amount: int, change: float) -> Tensor:
        with torch.no_grad():
            weight[amount, 0] += change
            found = differentiable_rollout(
                cast(Simulator, module.simulators[0]), batch.start, batch.steps, batch.every, recompute=False
            )
            weight[amount, 0] -= change
        return found

    for k in (2, 6, 9):  # cohesion, the round share, the direction of flow
        difference = (end(k, 1e-6) - end(k, -1e-6)) / 2e-6
        assert difference.abs().max() > 1e-6
        torch.testing.assert_close(derivatives[k], difference, rtol=1e-3, atol=1e-3 * float(difference.abs().max()))


@pytest.mark.slow
def test_a_surface_with_corners_is_found_and_the_elastic_law_stays(records: list[SceneRecord], tmp_path: Path) -> None:
    module, data = module_and_data(records, 6)
    before = module.checked(records).mse
    elastic = [weight.clone() for weight in module.laws.elasticity.parameters()]
    found = fit(module, data, tmp_path, torch.device("cpu"), console=Console(file=StringIO()))
    assert found.best.mse < 1e-2 * before
    assert all(torch.equal(*pair) for pair in zip(elastic, module.laws.elasticity.parameters(), strict=True))


def test_a_step_that_would_lead_away_is_not_taken(records: list[SceneRecord]) -> None:
    module, data = module_and_data(records)
    batch, before = data.dataset[0], module._amounts.weight.detach().clone()
    predicted, derivatives = module._linearised(batch)
    residual, _ = module._relative(batch, predicted, derivatives)
    here = module._misfit(batch, residual, before)
    assert module._misfit(batch, module._residual_at(batch, before), before) == pytest.approx(here, abs=1e-6)
    wanted = module._best(batch, before, residual, derivatives)
    assert module._misfit(batch, module._residual_at(batch, wanted), wanted) < here
    assert torch.equal(module._amounts.weight, before)


@pytest.mark.parametrize(("material", "network"), [("sand", "pcnclaws"), ("elasticity", "pcnclaws_energy")])
def test_laws_without_plastic_amounts_are_refused(material: str, network: str, records: list[SceneRecord]) -> None:
    laws = build_neural_laws(MATERIALS[material], {"name": network})
    with pytest.raises(UserError, match=r"training.method=levenberg_marquardt .* accepted: model=pcnclaws_convex"):
        LevenbergMarquardtModule(laws, [records[0].settings], OptimiserSettings(), 1)
