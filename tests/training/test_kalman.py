"""Kalman filter for weights: its equations against the textbook, its gradients against differences, laws found fast."""

from io import StringIO
from pathlib import Path
from typing import cast

import pytest
import torch
from rich.console import Console
from training_bodies import Scaled, hidden, recorded

from pcnclaws.data.datamodule import TrajectoryDataModule
from pcnclaws.data.segments import SegmentPlan
from pcnclaws.laws.analytic import Laws
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.simulation.rollout import differentiable_rollout
from pcnclaws.simulation.simulator import Simulator
from pcnclaws.training import equations as equations_file
from pcnclaws.training.equations import PRIOR, Equations
from pcnclaws.training.kalman import KalmanModule, _segments
from pcnclaws.training.losses import relative_errors, unstressed_positions
from pcnclaws.training.module import OptimiserSettings
from pcnclaws.training.trainer import fit

pytestmark = pytest.mark.filterwarnings("ignore:`torch.jit.script` is deprecated:DeprecationWarning")


@pytest.fixture(scope="module")
def records() -> list[SceneRecord]:
    return recorded(3)


def module_and_data(
    records: list[SceneRecord], kind: type[KalmanModule] = KalmanModule, iterations: int = 8
) -> tuple[KalmanModule, TrajectoryDataModule]:
    plan = SegmentPlan(iterations, 3, "keyframes", first=10, last=10)
    data = TrajectoryDataModule(records, records[:1], plan, 2)
    return kind(Laws(Scaled(), None), data.dataset.settings, OptimiserSettings(), iterations), data


def fitted(records: list[SceneRecord], folder: Path, kind: type[KalmanModule] = KalmanModule) -> float:
    module, data = module_and_data(records, kind)
    fit(module, data, folder, torch.device("cpu"), console=Console(file=StringIO()))
    return float(cast(Scaled, module.laws.elasticity).factor.detach())


def test_solution_is_that_of_the_filter_one_equation_after_the_other() -> None:
    """w <- w - K (e + g.(w - w_i)), K = P g/(g.P g + v), P <- P - K g.P: Kalman's update of mean and covariance."""
    random = torch.Generator().manual_seed(0)
    start = torch.randn(5, generator=random, dtype=torch.float64)
    known, mean, covariance = Equations(start), start.clone(), PRIOR**2 * torch.eye(5, dtype=torch.float64)
    for _ in range(4):
        at = known.solution() + 0.01 * torch.randn(5, generator=random, dtype=torch.float64)
        gradients = [*torch.randn(2, 5, generator=random, dtype=torch.float64)]
        errors, variances = [0.3, 0.02], [0.1, 1e-3]
        known.add(gradients, at, errors, variances)
        for gradient, error, variance in zip(gradients, errors, variances, strict=True):
            gain = covariance @ gradient / (gradient @ covariance @ gradient + variance)
            mean = mean - gain * (error + gradient @ (mean - at))
            covariance = covariance - torch.outer(gain, gradient @ covariance)
        torch.testing.assert_close(known.solution(), mean)


def test_the_latest_equations_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(equations_file, "MOST", 4)
    random = torch.Generator().manual_seed(0)
    start = torch.zeros(6, dtype=torch.float64)
    gradients = torch.randn(10, 6, generator=random, dtype=torch.float64)
    long, short = Equations(start), Equations(start)
    for i in range(0, 10, 2):
        for one in (long,) if i < 6 else (long, short):
            one.add([*gradients[i : i + 2]], start, [0.1, 0.2], [0.01, 0.01])
    assert len(long) == len(short) == 4
    torch.testing.assert_close(long.solution(), short.solution())


def test_squares_of_the_errors_are_the_relative_loss(records: list[SceneRecord]) -> None:
    module, data = module_and_data(hidden(records, 3, 5))
    batch = data.dataset[1]
    state, scenes, simulator = batch.start.state, batch.start.scenes, cast(Simulator, module.simulators[batch.group])
    predicted = differentiable_rollout(simulator, batch.start, batch.steps, batch.every)
    times = range(batch.every, batch.steps + 1, batch.every)
    unstressed = unstressed_positions(state, scenes, simulator.integrator.settings.time_step, times)
    together = relative_errors(predicted, batch.target, unstressed, scenes.scene_index, scenes.scene_count)
    alone = torch.stack([module._error(segment)[0] for segment in _segments(batch)])
    assert together.max() > 1e-3
    torch.testing.assert_close(alone.square(), together)


def test_gradients_are_those_of_differences(records: list[SceneRecord]) -> None:
    module, data = module_and_data(records)
    factor = cast(Scaled, module.laws.elasticity).factor
    for segment in _segments(data.dataset[1]):
        gradient, ends = module._gradient(module._error(segment)[0]), []
        for sign in (1.0, -1.0):
            with torch.no_grad():
                factor += sign * 1e-2
                ends.append(float(module._error(segment)[0]))
                factor -= sign * 1e-2
        assert float(gradient[0]) == pytest.approx((ends[0] - ends[1]) / 2e-2, rel=2e-2, abs=1e-6)


def test_a_law_is_found_in_a_few_iterations(records: list[SceneRecord], tmp_path: Path) -> None:
    assert fitted(records, tmp_path / "run") == pytest.approx(1.0, abs=1e-4)  # from 0.7


class _Stopped(Exception):
    pass


class _Interrupted(KalmanModule):
    """Stops at the sixth of eight iterations; the check after the fourth has left a checkpoint."""

    def on_train_batch_start(self, batch: object, batch_idx: int) -> None:
        if self.trainer.global_step == 5:
            raise _Stopped


def test_a_run_that_goes_on_ends_as_one_that_was_not_interrupted(records: list[SceneRecord], tmp_path: Path) -> None:
    whole = fitted(records, tmp_path / "whole")
    with pytest.raises(_Stopped):
        fitted(records, tmp_path / "stopped", _Interrupted)
    assert fitted(records, tmp_path / "stopped") == whole
