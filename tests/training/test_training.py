"""Training: the two regimes, what a bad gradient does, and what a check says."""

import math
from collections.abc import Sequence
from io import StringIO
from pathlib import Path
from typing import Any

import pytest
import torch
from rich.console import Console
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from torch.optim.lr_scheduler import CosineAnnealingLR
from training_bodies import Scaled, recorded

from pcnclaws.data.datamodule import TrajectoryDataModule
from pcnclaws.data.segments import SegmentPlan
from pcnclaws.errors import SimulationDiverged, UserError
from pcnclaws.laws.analytic import Laws
from pcnclaws.laws.base import Elasticity
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.laws.neural import build_neural_laws
from pcnclaws.simulation.law_simulator import LawSimulator
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.tensors.tensor_types import Matrices, Parameters
from pcnclaws.training import watched
from pcnclaws.training.loop import Loop
from pcnclaws.training.module import ConstitutiveModule, OptimiserSettings
from pcnclaws.training.multi_scene import MultiSceneModule
from pcnclaws.training.schedule import cosine_schedule, lengthen
from pcnclaws.training.single_scene import SingleSceneModule
from pcnclaws.training.trainer import DEFAULT_LOOP, FitResult, fit
from pcnclaws.training.weights import model_weights


@pytest.fixture(scope="module")
def records() -> list[SceneRecord]:
    return recorded(3)


def trained(
    module: type[ConstitutiveModule],
    laws: Laws,
    records: Sequence[SceneRecord],
    folder: Path,
    iterations: int = 4,
    start: str = "keyframes",
    console: Console | None = None,
    rate: float = 0.05,
    loop: Loop = DEFAULT_LOOP,
) -> FitResult:
    plan = SegmentPlan(iterations, 2, start, first=10, last=15 if start == "keyframes" else 20)
    data = TrajectoryDataModule(records, records[:1], plan, iterations // 2)
    regime = module(laws, data.dataset.settings, OptimiserSettings(rate, recompute=False), iterations)
    return fit(regime, data, folder, torch.device("cpu"), loop, console=console or Console(file=StringIO()))


class Brittle(Scaled):
    """A law whose stress is not finite, so that no gradient is."""

    def kirchhoff_stress(self, deformation: Matrices, parameters: Parameters) -> Matrices:
        return super().kirchhoff_stress(deformation, parameters) * math.inf


@pytest.mark.parametrize("start", ["keyframes", "initial"])
def test_training_finds_the_factor_of_the_recordings(records: list[SceneRecord], tmp_path: Path, start: str) -> None:
    law = Scaled(0.7)
    fitted = trained(MultiSceneModule, Laws(law, None), records, tmp_path, 16, start, rate=0.04)
    assert abs(float(law.factor.detach()) - 1.0) < 0.1
    untrained = MultiSceneModule(Laws(Scaled(0.7), None), [records[0].settings], OptimiserSettings(), 1)
    assert fitted.best.mse < 0.02 * untrained.checked(records[:1]).mse
    assert fitted.best.mse == min(fitted.history.check_mse)
    assert len(fitted.history.loss) == 16
    assert fitted.history.check_iteration == [8, 16]


def test_with_one_scene_both_regimes_give_the_same_weights(records: list[SceneRecord], tmp_path: Path) -> None:
    weights = []
    for regime in (SingleSceneModule, MultiSceneModule):
        torch.manual_seed(3)
        laws = build_neural_laws(MATERIALS["elasticity"], {"name": "pcnclaws", "width": 8})
        trained(regime, laws, regime.choose_scenes(records[:1], None), tmp_path / regime.__name__)
        weights.append(model_weights(LawSimulator(laws)))
    untrained = model_weights(
        LawSimulator(build_neural_laws(MATERIALS["elasticity"], {"name": "pcnclaws", "width": 8}))
    )
    assert any(not torch.equal(weights[0][name], untrained[name]) for name in untrained)
    for name, weight in weights[0].items():
        assert torch.equal(weight, weights[1][name]), name


def test_the_regimes_choose_their_scenes(records: list[SceneRecord]) -> None:
    assert SingleSceneModule.choose_scenes(records, None) == records[:1]
    assert SingleSceneModule.choose_scenes(records, 2) == records[2:]
    assert SingleSceneModule.choose_scenes(records, "body_1") == records[1:2]
    assert MultiSceneModule.choose_scenes(records, None) == records
    with pytest.raises(UserError, match="regime.scene=3 is out of range; accepted: 0 to 2"):
        SingleSceneModule.choose_scenes(records, 3)
    with pytest.raises(UserError, match="regime.scene='body_7'.*did you mean"):
        SingleSceneModule.choose_scenes(records, "body_7")
    with pytest.raises(UserError, match="regime=single_scene"):
        MultiSceneModule.choose_scenes(records, 0)


def test_both_precisions_train(records: list[SceneRecord], tmp_path: Path) -> None:
    law = Scaled(0.7).double()
    plan = SegmentPlan(2, 2, first=10, last=10)
    data = TrajectoryDataModule(records, records[:1], plan, 2, torch.float64)
    module = MultiSceneModule(Laws(law, None), data.dataset.settings, OptimiserSettings(0.05), 2)
    fit(module, data, tmp_path, torch.device("cpu"), console=Console(file=StringIO()))
    assert law.factor.dtype == torch.float64
    assert float(law.factor.detach()) != 0.7


def test_an_iteration_without_a_finite_gradient_changes_nothing(
    records: list[SceneRecord], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    law = Brittle(0.7)
    with pytest.raises(SimulationDiverged, match="every check of the run diverged"):
        trained(MultiSceneModule, Laws(law, None), records, tmp_path)
    assert float(law.factor.detach()) == pytest.approx(0.7)
    assert "iteration 0 skipped: its gradient is not finite (1 skipped so far)" in caplog.text
    assert "check failed: scene 'body_0' diverged" in caplog.text


def test_many_bad_gradients_in_a_row_end_the_run(
    records: list[SceneRecord], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watched, "MOST_SKIPPED", 3)
    with pytest.raises(SimulationDiverged, match=r"no finite gradient in 3 iterations in a row.*learning_rate"):
        trained(MultiSceneModule, Laws(Brittle(0.7), None), records, tmp_path)


class Limited(Scaled):
    """A law that breaks where its factor exceeds 0.95."""

    def kirchhoff_stress(self, deformation: Matrices, parameters: Parameters) -> Matrices:
        stress = super().kirchhoff_stress(deformation, parameters)
        return stress * torch.where(self.factor < 0.95, 1.0, torch.nan)


def test_a_run_that_breaks_late_keeps_its_best_law(
    records: list[SceneRecord], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(watched, "MOST_SKIPPED", 3)
    data = TrajectoryDataModule(records[:1], records[:1], SegmentPlan(9, None, first=20, last=20), 1)
    law = Limited(0.7)
    module = MultiSceneModule(Laws(law, None), data.dataset.settings, OptimiserSettings(0.15), 9)
    result = fit(module, data, tmp_path, torch.device("cpu"), console=Console(file=StringIO()))
    assert result.stopped is not None
    assert "no finite gradient in 3 iterations in a row" in result.stopped
    assert "is kept" in caplog.text
    assert 0.7 < float(result.best.weights["elasticity.factor"]) < 0.95


def test_a_step_too_far_can_be_taken_back(records: list[SceneRecord], tmp_path: Path) -> None:
    plan = SegmentPlan(6, None, first=20, last=20)  # all batches are alike
    data = TrajectoryDataModule(records[:1], records[:1], plan, 6)
    for step_back in (True, False):
        law = Limited(0.7)
        settings = OptimiserSettings(0.4, step_back=step_back)
        module = SingleSceneModule(Laws(law, None), data.dataset.settings, settings, 6)
        folder = tmp_path / str(step_back)
        if step_back:
            fitted = fit(module, data, folder, torch.device("cpu"), console=Console(file=StringIO()))
            assert 0 < fitted.skipped < 6
            assert 0.7 < float(law.factor.detach()) < 0.95
        else:
            with pytest.raises(SimulationDiverged, match="every check of the run diverged"):
                fit(module, data, folder, torch.device("cpu"), console=Console(file=StringIO()))


def test_a_check_of_the_true_law_is_exact(records: list[SceneRecord]) -> None:
    law: Elasticity = Scaled(1.0)
    module = MultiSceneModule(Laws(law, None), [records[0].settings], OptimiserSettings(), 1)
    assert module.checked(records).mse < 1e-12


def test_progress_says_where_the_run_is(records: list[SceneRecord], tmp_path: Path) -> None:
    said = StringIO()
    trained(MultiSceneModule, Laws(Scaled(0.7), None), records, tmp_path, console=Console(file=said, width=120))
    lines = said.getvalue().splitlines()
    assert [line.split()[1] for line in lines] == ["2/4", "4/4"]
    assert all(word in lines[0] for word in ("loss", "check", "it/s", "left"))
    assert list((tmp_path / "tensorboard").glob("events*"))


def test_tensorboard_is_shown_each_scene_and_law(records: list[SceneRecord], tmp_path: Path) -> None:
    laws = build_neural_laws(MATERIALS["elasticity"], {"name": "pcnclaws", "width": 8})
    trained(MultiSceneModule, laws, records, tmp_path)
    shown = EventAccumulator(str(tmp_path / "tensorboard")).Reload()
    tags, scenes = shown.Tags(), [records[0].name]
    whole, of_one = (shown.Scalars(name)[-1].value for name in ("validation_mse", f"validation/{scenes[0]}"))
    assert whole == of_one, "it is the only one"
    whole, elastic = (shown.Scalars(name)[-1].value for name in ("gradient_norm", "gradient_norm/elasticity"))
    assert whole == elastic > 0.0, "the law has no other part"
    assert shown.Scalars("iteration_seconds")[-1].value > 0.0
    assert {f"motion/{name}" for name in scenes} == set(tags["images"])
    assert {f"points/{name}_{part}" for name in scenes for part in ("VERTEX", "COLOR")} <= set(tags["tensors"])
    names = {f"weights/elasticity.{name}" for name, _ in laws.elasticity.named_parameters()}
    assert names | {f"features/elasticity/{k}" for k in range(3)} == set(tags["histograms"])
    trained(MultiSceneModule, laws, records, tmp_path / "plain", loop=Loop(pictures=False))
    tags = EventAccumulator(str(tmp_path / "plain" / "tensorboard")).Reload().Tags()
    assert tags["images"] == tags["tensors"] == []


def test_a_run_checks_and_keeps_the_average(records: list[SceneRecord], tmp_path: Path) -> None:
    law = Scaled(0.7)
    fitted = trained(MultiSceneModule, Laws(law, None), records, tmp_path / "a", loop=Loop(average=0.0))
    plain = Scaled(0.7)
    trained(MultiSceneModule, Laws(plain, None), records, tmp_path / "b", loop=Loop())
    (kept,) = (float(weight) for weight in fitted.best.weights.values())
    last = float(plain.factor.detach())
    assert 0.7 < kept < last, "the mean of a weight that grows is behind it"
    assert float(law.factor.detach()) == pytest.approx(kept) or fitted.best.iteration < 4
    module = MultiSceneModule(Laws(Scaled(kept), None), [records[0].settings], OptimiserSettings(), 1)
    assert module.checked(records[:1]).mse == pytest.approx(fitted.best.mse, rel=1e-4)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"learning_rate": 0.0}, "training.learning_rate=0.0"),
        ({"learning_rate": math.nan}, "training.learning_rate=nan"),
        ({"gradient_clip": -1.0}, "training.gradient_clip=-1.0"),
        ({"final_learning_rate": 1.0}, "training.final_learning_rate=1.0"),
        ({"loss": "relativ"}, "training.loss='relativ'.*did you mean 'relative'"),
    ],
)
def test_nonsense_optimiser_settings_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(UserError, match=message):
        OptimiserSettings(**options)


def test_a_longer_schedule_of_learning_rates_is_that_of_a_run_that_was_so_long_from_the_start() -> None:
    def rates(schedule: CosineAnnealingLR, count: int) -> list[float]:
        found = []
        for _ in range(count):
            schedule.optimizer.step()
            schedule.step()
            found.append(schedule.optimizer.param_groups[0]["lr"])
        return found

    def schedule(iterations: int) -> CosineAnnealingLR:
        return cosine_schedule(torch.optim.Adam([torch.zeros(1, requires_grad=True)], lr=0.1), iterations, 0.01)

    short, whole = schedule(5), schedule(12)
    assert rates(short, 5)[-1] == pytest.approx(0.01)
    lengthen(short, 12)
    assert rates(short, 7) == pytest.approx(rates(whole, 12)[5:])
