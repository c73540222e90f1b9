"""Recorded runs: scenes simulated with laws, and what is recorded of them."""

import copy
from collections.abc import Sequence

import numpy as np

from pcnclaws.laws.analytic import Laws
from pcnclaws.simulation.batch import SceneBatch, batch_scenes
from pcnclaws.simulation.execution import SINGLE_ON_CPU, Execution
from pcnclaws.simulation.recording import FramePlan, Trajectory
from pcnclaws.simulation.records import Keyframes, SceneRecord
from pcnclaws.simulation.restart import going_on_falling
from pcnclaws.simulation.rollout import simulate_scenes
from pcnclaws.simulation.scenes import SceneStart, group_by_settings
from pcnclaws.simulation.simulator import simulator_of
from pcnclaws.tensors.layout import split_matrices, split_vectors


def simulate_records(
    starts: Sequence[SceneStart],
    laws: Laws,
    plan: FramePlan,
    execution: Execution = SINGLE_ON_CPU,
) -> list[SceneRecord]:
    """Simulates scenes, those of the same settings as one batch, and records them; results in the order of `starts`.

    plan       length of the runs and what is kept of them
    execution  its progress hears of plan.steps x len(group_by_settings(starts)) steps in all
    raises     SimulationDiverged, naming scene, step and particle
    """
    dtype, device, skips = execution.dtype, execution.device, execution.skips
    done: dict[int, SceneRecord] = {}
    names = [variable.name for variable in laws.internal_variables]
    for group in group_by_settings(starts):
        simulator = copy.deepcopy(simulator_of(laws, group[0].settings, skips)).to(device=device, dtype=dtype)
        batch = batch_scenes(group, dtype, device, laws.internal_variables)
        whole_plan = plan._replace(start_state=any(start.is_deformed for start in group))
        begun, fallen_steps = going_on_falling(group, batch) if skips.free_fall else (batch, None)
        trajectory = simulate_scenes(simulator, begun, whole_plan, skips, execution.progress, fallen_steps=fallen_steps)
        done |= {
            id(start): record for start, record in zip(group, _records(group, batch, trajectory, names), strict=True)
        }
    return [done[id(start)] for start in starts]


def _records(
    starts: Sequence[SceneStart], batch: SceneBatch, trajectory: Trajectory, internal_names: Sequence[str]
) -> list[SceneRecord]:
    """internal_names: of the internal variables that the trajectory holds."""
    counts = batch.particle_counts
    step, keyframe_step = trajectory.step.numpy(), trajectory.keyframe_step.numpy()
    vectors = (trajectory.position, trajectory.velocity, trajectory.keyframe_velocity)
    fields = [split_vectors(field, counts) for field in vectors]
    fields += [split_matrices(field, counts) for field in (trajectory.affine, trajectory.deformation)]
    remembered = [one.cpu().numpy() for one in trajectory.internal.split(counts, dim=-1)]
    records = []
    for scene, (start, internal, position, velocity, *full_states) in enumerate(
        zip(starts, remembered, *fields, strict=True)
    ):
        variables = dict(zip(internal_names, internal.swapaxes(0, 1), strict=True))
        parameters = {name: value for name, value in start.parameters.items() if name not in start.varying}
        at = np.searchsorted(step, keyframe_step)
        records.append(
            SceneRecord(
                start.name,
                start.material,
                start.settings,
                parameters,
                time=step * start.settings.time_step,
                position=position,
                volume=start.volume.astype(position.dtype),
                initial_velocity=start.velocity.astype(position.dtype),
                velocity=velocity if len(velocity) else None,
                keyframes=Keyframes(keyframe_step, position[at], *full_states, internal=variables) if len(at) else None,
                initial_affine=None
                if start.affine is None or not start.affine.any()
                else start.affine.astype(position.dtype),
                density=None if start.density is None else start.density.astype(position.dtype),
                impulses=trajectory.impulses[:, scene].numpy() if start.settings.colliders else None,
                loaded_at=None if start.loaded_at is None else start.loaded_at.astype(position.dtype),
            )
        )
    return records
