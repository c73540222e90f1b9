"""Averaged weights: their closed forms, and which check's weights are kept."""

import math

import pytest
import torch
from lightning.pytorch import Trainer
from torch import nn
from torch.optim.swa_utils import AveragedModel
from training_bodies import Scaled, recorded

from pcnclaws.errors import UserError
from pcnclaws.laws.analytic import Laws
from pcnclaws.training.averaging import AveragedWeights
from pcnclaws.training.callbacks import BestWeights
from pcnclaws.training.checks import Check
from pcnclaws.training.module import OptimiserSettings
from pcnclaws.training.multi_scene import MultiSceneModule


def averaged(power: float, values: list[float]) -> float:
    """The average of a weight that has these values one after the other."""
    layer = nn.Linear(1, 1, bias=False).double()
    average = AveragedModel(layer, avg_fn=AveragedWeights(power)._towards)
    for value in values:
        with torch.no_grad():
            layer.weight.fill_(value)
        average.update_parameters(layer)
    return float(next(average.parameters()).detach())


def test_power_zero_is_the_mean_and_larger_powers_forget_the_beginning() -> None:
    values = [5.0, 1.0, -2.0, 0.5, 3.0]
    assert averaged(0.0, values) == pytest.approx(sum(values) / 5)
    # the first of n values is left behind as a product of 1 - (power + 1)/(k + power)
    beginning = averaged(8.0, [1.0] + [0.0] * 99)
    assert beginning == pytest.approx(math.prod(1.0 - 9.0 / (k + 8.0) for k in range(2, 101)))
    assert beginning < 1e-9
    # of a straight line it is the value of the weighted mean of the iterations, (power + 1)/(power + 2) of the way
    line = averaged(8.0, [float(k) for k in range(1, 2001)])
    assert line / 2000 == pytest.approx(9 / 10, rel=1e-2)


@pytest.mark.parametrize("power", [-1.0, math.inf, math.nan])
def test_other_powers_are_refused(power: float) -> None:
    with pytest.raises(UserError, match=f"training.average={power} is not accepted"):
        AveragedWeights(power)


def checked(best: BestWeights, module: MultiSceneModule, mse: float, factor: float) -> None:
    """Lets a check of this error come, of a law with this factor."""
    record = recorded(1)[0]
    away = record.position + math.sqrt(mse)
    module.check = Check((record,), (away.astype("float64"),))
    with torch.no_grad():
        next(module.parameters()).fill_(factor)

    best.on_validation_epoch_end(Trainer(logger=False, enable_checkpointing=False), module)


@pytest.mark.parametrize(("tolerance", "kept"), [(1.0, 0.2), (4.0, 0.3)])
def test_a_later_check_that_is_as_good_is_kept(tolerance: float, kept: float) -> None:
    """Errors 4, 1, 3, 9: the smallest is the second; within a factor of 4 of it, the third is as good."""
    law = Scaled(1.0)
    module = MultiSceneModule(Laws(law, None), [recorded(1)[0].settings], OptimiserSettings(), 1)
    best = BestWeights(module.model, tolerance=tolerance)
    for number, mse in enumerate((4e-6, 1e-6, 3e-6, 9e-6), start=1):
        checked(best, module, mse, 0.1 * number)
    (weight,) = best.weights.values()
    assert float(weight) == pytest.approx(kept)
    assert best.smallest == pytest.approx(1e-6, rel=1e-2)
    again = BestWeights(module.model, tolerance=tolerance)
    again.load_state_dict(best.state_dict())
    assert (again.mse, again.smallest, again.iteration) == (best.mse, best.smallest, best.iteration)
