"""Gauss-Newton for laws that are linear in their weights: exact derivatives, and motions fitted to their rounding."""

import copy
from dataclasses import replace
from io import StringIO
from pathlib import Path

import pytest
import torch
from rich.console import Console
from training_bodies import recorded

from pcnclaws.data.datamodule import TrajectoryDataModule
from pcnclaws.data.segments import SegmentPlan
from pcnclaws.errors import UserError
from pcnclaws.laws.analytic import Laws
from pcnclaws.laws.elasticity import NeoHookean
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.laws.neural import build_neural_laws
from pcnclaws.laws.viscosity import NewtonianViscosity
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.training.gauss_newton import GaussNewtonModule
from pcnclaws.training.module import OptimiserSettings
from pcnclaws.training.sources import show_deformations
from pcnclaws.training.trainer import fit

pytestmark = pytest.mark.filterwarnings("ignore:`torch.jit.script` is deprecated:DeprecationWarning")


@pytest.fixture(scope="module")
def records() -> list[SceneRecord]:
    """Neo-Hookean bodies, whose law is among the sums of the energy net."""
    return recorded(3, NeoHookean())


def untrained(records: list[SceneRecord]) -> Laws:
    laws = build_neural_laws(MATERIALS["elasticity"], {"name": "pcnclaws_energy"})
    show_deformations(laws.elasticity, records)
    return laws


def module_and_data(
    records: list[SceneRecord], laws: Laws, kind: type[GaussNewtonModule] = GaussNewtonModule
) -> tuple[GaussNewtonModule, TrajectoryDataModule]:
    plan = SegmentPlan(8, 3, "keyframes", first=10, last=10)
    data = TrajectoryDataModule(records, records[:1], plan, 2, torch.float64)
    return kind(laws, data.dataset.settings, OptimiserSettings(), 8), data


def fitted(
    records: list[SceneRecord], folder: Path, kind: type[GaussNewtonModule] = GaussNewtonModule
) -> tuple[Laws, float]:
    module, data = module_and_data(records, untrained(records), kind)
    result = fit(module, data, folder, torch.device("cpu"), console=Console(file=StringIO()))
    return module.laws, result.best.mse


def test_derivatives_by_the_amounts_are_those_of_differences(records: list[SceneRecord]) -> None:
    module, data = module_and_data(records, untrained(records))
    batch, weight = data.dataset[0], module._amounts.weight
    _, derivatives = module._linearised(batch)
    assert module.laws.elasticity.is_bounded
    for k in (0, 7, 14):
        ends = []
        for sign in (1.0, -1.0):
            with torch.no_grad():
                weight[k, 0] += sign * 1e-4
            ends.append(module._linearised(batch)[0])
            with torch.no_grad():
                weight[k, 0] -= sign * 1e-4
        difference = (ends[0] - ends[1]) / 2e-4
        assert difference.abs().max() > 1e-8
        torch.testing.assert_close(derivatives[k], difference, rtol=1e-4, atol=1e-6 * float(difference.abs().max()))


def test_a_law_of_another_form_is_found_to_the_rounding_of_the_data(records: list[SceneRecord], tmp_path: Path) -> None:
    laws, error = fitted(records, tmp_path / "run")
    assert error < 1e-10, "the best of Adam is 1e-8"
    parameters = {"youngs_modulus": torch.tensor([2e4]), "poissons_ratio": torch.tensor([0.23])}
    doubled = {name: value.double() for name, value in parameters.items()}
    f = torch.diag(torch.tensor([0.95, 1.02, 1.0], dtype=torch.float64))[:, :, None]
    truth = NeoHookean()(f, doubled)
    assert (laws.elasticity(f, doubled) - truth).abs().max() < 0.01 * truth.abs().max()


class _Stopped(Exception):
    pass


class _Interrupted(GaussNewtonModule):
    """Stops at the sixth of eight iterations; the check after the fourth has left a checkpoint."""

    def on_train_batch_start(self, batch: object, batch_idx: int) -> None:
        if self.trainer.global_step == 5:
            raise _Stopped


@pytest.mark.slow
def test_a_run_that_goes_on_ends_as_one_that_was_not_interrupted(records: list[SceneRecord], tmp_path: Path) -> None:
    whole, _ = fitted(records, tmp_path / "whole")
    with pytest.raises(_Stopped):
        fitted(records, tmp_path / "stopped", _Interrupted)
    continued, _ = fitted(records, tmp_path / "stopped")
    for one, other in zip(whole.elasticity.parameters(), continued.elasticity.parameters(), strict=True):
        assert torch.equal(one, other)


def test_a_viscosity_beside_the_elasticity_acts_in_training(records: list[SceneRecord]) -> None:
    laws, positions = untrained(records)._replace(viscosity=NewtonianViscosity()), []
    viscous = [replace(one, parameters={**one.parameters, "viscosity": 50.0}) for one in records]
    for given in (laws, laws._replace(viscosity=None)):
        module, data = module_and_data(viscous, given)
        positions.append(module._linearised(data.dataset[0])[0])
    assert (positions[0] - positions[1]).abs().max() > 1e-7


def test_laws_that_are_not_linear_in_their_weights_are_refused(records: list[SceneRecord]) -> None:
    for material, network in (("elasticity", "pcnclaws"), ("sand", "pcnclaws_energy")):
        laws = build_neural_laws(MATERIALS[material], {"name": network})
        with pytest.raises(UserError, match=r"training.method=gauss_newton .* accepted: model=pcnclaws_energy"):
            module_and_data(records, copy.deepcopy(laws))
