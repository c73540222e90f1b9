"""Training segments: which pieces of which scenes a run sees."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from training_bodies import EVERY, SETTINGS, hidden, recorded

from pcnclaws.data.datamodule import EpochSampler, TrajectoryDataModule
from pcnclaws.data.dataset import SegmentBatch, SegmentDataset
from pcnclaws.data.segments import SegmentPlan
from pcnclaws.errors import UserError
from pcnclaws.laws.elasticity import FixedCorotated
from pcnclaws.mpm.integrator import MPMIntegrator
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.simulation.rollout import differentiable_rollout
from pcnclaws.simulation.simulator import Simulator
from pcnclaws.training.losses import NEGLIGIBLE, position_loss, relative_errors, unstressed_positions


@pytest.fixture(scope="module")
def records() -> list[SceneRecord]:
    return recorded(3)


def simulated(batch: SegmentBatch) -> torch.Tensor:
    simulator = Simulator(FixedCorotated(), None, MPMIntegrator(SETTINGS))
    return differentiable_rollout(simulator, batch.start, batch.steps, batch.every, recompute=False)


@pytest.mark.parametrize("start", ["keyframes", "initial"])
def test_the_law_of_the_recording_meets_every_target(records: list[SceneRecord], start: str) -> None:
    dataset = SegmentDataset(records, SegmentPlan(20, 4, start, first=10, last=30))
    for iteration in (0, 19):
        batch = dataset[iteration]
        assert batch.target.shape == (batch.steps // EVERY, 3, 4 * 64)
        torch.testing.assert_close(simulated(batch), batch.target, atol=2e-6, rtol=0.0)


def test_a_batch_depends_on_seed_and_iteration_alone(records: list[SceneRecord]) -> None:
    plan = SegmentPlan(20, 4, first=10, last=30)
    first, again = SegmentDataset(records, plan)[7], SegmentDataset(records, plan)[7]
    assert torch.equal(first.start.state.position, again.start.state.position)
    assert torch.equal(first.target, again.target)
    assert not torch.equal(first.start.state.position, SegmentDataset(records, plan)[8].start.state.position)
    assert not torch.equal(
        first.start.state.position, SegmentDataset(records, replace(plan, seed=1))[7].start.state.position
    )


def test_every_scene_is_used_before_one_comes_again(records: list[SceneRecord]) -> None:
    batch = SegmentDataset(records, SegmentPlan(20, 3, first=10, last=10))[0]
    assert len(batch.start.parameters["youngs_modulus"].unique()) == 3


def test_segments_grow_by_half_a_cosine_in_whole_frames() -> None:
    plan = SegmentPlan(101, first=10, last=50)
    lengths = [plan.length(iteration, 5, 500) for iteration in range(101)]
    assert lengths[0] == 10
    assert lengths[50] == 30
    assert lengths[100] == 50
    assert lengths == sorted(lengths)
    assert all(length % 5 == 0 for length in lengths)
    assert plan.length(100, 5, 40) == 40, "never longer than the motion"
    assert SegmentPlan(1, first=3, last=3).length(0, 5, 500) == 5, "at least one frame"


def test_from_the_initial_state_segments_grow_to_the_whole_motion_by_default() -> None:
    plan = SegmentPlan(10, start="initial")
    assert plan.length(0, 5, 500) == 250
    assert plan.length(9, 5, 500) == 500


def test_positions_only_starts_never_read_a_keyframe(records: list[SceneRecord]) -> None:
    without = [replace(record, keyframes=None, velocity=None) for record in records]
    plan = SegmentPlan(5, 2, "initial", first=20, last=40)
    a, b = SegmentDataset(records, plan)[3], SegmentDataset(without, plan)[3]
    assert torch.equal(a.start.state.deformation, b.start.state.deformation)
    assert torch.equal(a.target, b.target)


def test_missing_frames_and_unobserved_particles_are_nan(records: list[SceneRecord]) -> None:
    sparse = [
        replace(record, time=record.time[::2], position=record.position[::2], velocity=None) for record in records[:1]
    ]
    batch = SegmentDataset([*sparse, records[1]], SegmentPlan(1, 2, "initial", first=20, last=20))[0]
    assert batch.every == EVERY
    assert int(torch.isnan(batch.target).any(1).all(1).sum()) == 0, "a frame that any scene recorded is kept"
    assert int(torch.isnan(batch.target).sum()) == 2 * 3 * 64
    unseen = SegmentDataset(hidden(records, 1, 5), SegmentPlan(1, 3, "initial", first=20, last=20))[0]
    assert int(torch.isnan(unseen.target).sum()) == 3 * 3 * 4


def test_unobserved_particles_count_for_nothing_and_send_no_gradient() -> None:
    predicted = torch.ones(2, 3, 4, requires_grad=True)
    target = torch.zeros(2, 3, 4)
    target[:, :, 1] = float("nan")
    target[1, :, 2] = 3.0
    loss = position_loss(predicted, target)
    loss.backward()
    assert float(loss.detach()) == pytest.approx((15 * 1.0 + 3 * 4.0) / 18)
    assert predicted.grad is not None
    assert torch.isfinite(predicted.grad).all()
    assert bool((predicted.grad[:, :, 1] == 0.0).all())
    nothing = position_loss(predicted, torch.full((2, 3, 4), float("nan")))
    assert float(nothing.detach()) == 0.0


def test_the_relative_loss_weighs_each_segment_by_its_motion() -> None:
    segments, target = torch.tensor([0, 0, 1]), torch.zeros(2, 3, 3)
    unstressed = torch.full((2, 3, 3), 0.1)
    unstressed[:, :, 2] = 10.0
    predicted = torch.full((2, 3, 3), 0.01, requires_grad=True)
    loss = relative_errors(predicted, target, unstressed, segments, 2).mean()
    assert float(loss.detach()) == pytest.approx(0.5 * (1e-4 / (1e-2 + NEGLIGIBLE) + 1e-4 / (100.0 + NEGLIGIBLE)))

    target[:, :, 1] = float("nan")
    unstressed[:, :, 1] = 5.0
    masked = relative_errors(predicted, target, unstressed, segments, 2).mean()
    masked.backward()
    assert float(masked.detach()) == pytest.approx(float(loss.detach())), "an unobserved particle counts for nothing"
    assert predicted.grad is not None
    assert torch.isfinite(predicted.grad).all()
    assert bool((predicted.grad[:, :, 1] == 0.0).all())
    still = relative_errors(predicted, torch.full((2, 3, 3), float("nan")), unstressed, segments, 2).mean()
    assert float(still.detach()) == 0.0


def test_unstressed_positions_are_those_of_the_discrete_free_fall(records: list[SceneRecord]) -> None:
    batch = SegmentDataset(records, SegmentPlan(1, 3, first=20, last=20))[0]
    position, velocity = batch.start.state.position.clone(), batch.start.state.velocity.clone()
    found = unstressed_positions(batch.start.state, batch.start.scenes, SETTINGS.time_step, range(5, 21, 5))
    for step in range(1, 21):
        velocity = velocity + SETTINGS.time_step * batch.start.scenes.gravity[:, batch.start.scenes.scene_index]
        position = position + SETTINGS.time_step * velocity
        if step % 5 == 0:
            torch.testing.assert_close(found[step // 5 - 1], position, rtol=0.0, atol=1e-6)


def test_scenes_of_different_settings_never_share_a_batch(records: list[SceneRecord]) -> None:
    finer = replace(records[0], settings=replace(SETTINGS, grid_spacing=1 / 16))
    dataset = SegmentDataset([*records, finer], SegmentPlan(40, 2, first=10, last=10))
    assert [setting.grid_spacing for setting in dataset.settings] == [1 / 12, 1 / 16]
    groups = {dataset[iteration].group for iteration in range(40)}
    assert groups == {0, 1}


def test_the_data_module_says_what_is_wrong(records: list[SceneRecord]) -> None:
    with pytest.raises(UserError, match=r"training.check_every=7 .*divisor of training.iterations=20"):
        TrajectoryDataModule(records, records, SegmentPlan(20), 7)
    with pytest.raises(UserError, match=r"training.loss_every=7 .*multiple of the 5 steps"):
        SegmentDataset(records, SegmentPlan(20, frame_every=7))
    with pytest.raises(UserError, match="training.batch_segments=0"):
        SegmentPlan(20, 0)
    with pytest.raises(UserError, match="training.start='keyframe'.*did you mean 'keyframes'"):
        SegmentPlan(20, start="keyframe")
    one_frame = replace(records[0], time=records[0].time[:1], position=records[0].position[:1], velocity=None)
    with pytest.raises(UserError, match="one frame"):
        SegmentDataset([one_frame], SegmentPlan(20))


def test_epochs_walk_through_the_iterations(records: list[SceneRecord]) -> None:
    sampler = EpochSampler(4)
    sampler.set_epoch(2)
    assert list(sampler) == [8, 9, 10, 11]
    data = TrajectoryDataModule(records, records[:1], SegmentPlan(20, 2, first=10, last=10), 5)
    assert data.epochs == 4
    assert data.dataset.settings == [SETTINGS]
    batch = next(iter(data.train_dataloader()))
    assert isinstance(batch, SegmentBatch)
    assert np.array_equal(next(iter(data.val_dataloader()))[0].position, records[0].position)
