"""Start times: what moves with time is where it should be in runs that start later."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from pcnclaws.data.dataset import SegmentDataset
from pcnclaws.data.segments import SegmentPlan
from pcnclaws.data.timeline import Timeline
from pcnclaws.errors import UserError
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.materials import material_named
from pcnclaws.mpm.colliders import Collider
from pcnclaws.mpm.loads import Load
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.simulation.execution import Execution
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.simulation.rollout import differentiable_rollout
from pcnclaws.simulation.scenes import SceneStart
from pcnclaws.simulation.simulator import simulator_of

LAWS = analytic_laws(material_named("sand"))
PISTON = Collider.plane((0.36, 0.0, 0.0), (1.0, 0.0, 0.0), velocity=(2.0, 0.0, 0.0), start=0.005, friction=0.2)
PUSH = Load((0.3, 0.1, 0.3), (0.5, 0.3, 0.7), acceleration=(0.0, 3.0, 9.0), start=0.004, end=0.02)
STEPS, EVERY = 60, 15


def run(start: SceneStart, steps: int) -> SceneRecord:
    plan = FramePlan(steps, EVERY, keyframe_every=EVERY, velocities=True)
    return simulate_records([start], LAWS, plan, Execution(torch.float64))[0]


@pytest.fixture(scope="module")
def whole() -> SceneRecord:
    along = 0.4 + 0.2 * (np.arange(4) + 0.5) / 4
    position = np.stack(np.meshgrid(along, along - 0.25, along, indexing="ij"), axis=-1).reshape(-1, 3)
    settings = SimulationSettings(colliders=(PISTON,), loads=(PUSH,))
    parameters = {"youngs_modulus": 3e5, "poissons_ratio": 0.3, "friction_angle": 30.0}
    volume = np.full(64, 0.2**3 / 64)
    return run(SceneStart("pushed", "sand", settings, parameters, position, np.zeros((64, 3)), volume), STEPS)


@pytest.mark.parametrize("k", [15, 30])
def test_a_run_that_goes_on_from_a_restart_state_is_the_whole_run_to_the_last_bit(whole: SceneRecord, k: int) -> None:
    later = Timeline(whole, "keyframes").begin(k)
    rest = run(later, STEPS - k)
    assert later.settings.start_time == pytest.approx(k * 5e-4)
    assert float(np.abs(whole.impulses[-1]).max()) > 1.0  # pyright: ignore[reportOptionalSubscript]
    np.testing.assert_array_equal(rest.position, whole.position[k // EVERY :])
    np.testing.assert_array_equal(rest.velocity, whole.velocity[k // EVERY :])  # pyright: ignore[reportOptionalSubscript]
    at_zero = run(replace(later, settings=replace(later.settings, start_time=0.0)), STEPS - k)
    assert float(np.abs(at_zero.position[-1] - rest.position[-1]).max()) > 1e-4


def test_segments_of_a_training_show_what_was_recorded(whole: SceneRecord) -> None:
    plan = SegmentPlan(4, segments=3, first=EVERY, last=EVERY, seed=1)
    data = SegmentDataset([whole], plan, torch.float64)
    begins = set()
    for batch in (data[k] for k in range(4)):
        begins.add(batch.start_time)
        simulator = simulator_of(LAWS, replace(data.settings[batch.group], start_time=batch.start_time))
        found = differentiable_rollout(simulator, batch.start, batch.steps, batch.every)
        torch.testing.assert_close(found, batch.target, rtol=0, atol=1e-13)
    assert len(begins) > 1
    with pytest.raises(UserError, match=r"training\.batch_segments=null"):
        SegmentDataset([whole], replace(plan, segments=None))


def test_times_of_a_later_start_are_those_of_the_whole_run() -> None:
    settings = SimulationSettings(time_step=1e-4)
    for k in (1, 3, 7, 1001):
        later = replace(settings, start_time=settings.time_at(k))
        assert [later.time_at(n) for n in range(50)] == [settings.time_at(k + n) for n in range(50)]
    between = replace(settings, start_time=0.00025)
    assert between.time_at(2) == pytest.approx(0.00045, rel=1e-12)
    with pytest.raises(UserError, match=r"scene\.start_time=nan"):
        replace(settings, start_time=float("nan"))
