"""Restart: a scene that goes on from a later frame of its recording, N steps being k steps and N - k."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch

from pcnclaws.errors import UserError
from pcnclaws.simulation.batch import SceneBatch, batch_scenes
from pcnclaws.simulation.free_fall import fallen
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.simulation.scenes import Fall, SceneStart, restarted, start_of

# At most so many frames are listed.
LISTED = 12


def restart_of(record: SceneRecord, frame: object, option: str = "frame") -> SceneStart:
    """The scene from one of its recorded frames on.

    frame   counted from the end where it is negative; one at which a restart state was kept
    option  what the caller calls it, for messages
    raises  UserError for a frame that does not exist or holds no restart state
    """
    count = len(record.time)
    if isinstance(frame, bool) or not isinstance(frame, int) or not -count <= frame < count:
        raise UserError(f"{option}={frame} does not exist in {record.label}; accepted: {-count} to {count - 1}")
    start, keyframes = start_of(record), record.keyframes
    steps = record.frame_steps()
    known = np.zeros(0, np.int64) if keyframes is None else keyframes.step
    if keyframes is None or steps[frame] not in known:
        raise UserError(
            f"{option}={frame} of {record.label} (step {steps[frame]}) holds no restart state; accepted: "
            f"{_frames_in_words(np.flatnonzero(np.isin(steps, known)))}"
        )
    step = int(steps[frame])
    if step == 0:
        return start
    later = restarted(start, keyframes, int(np.flatnonzero(known == step)[0]))
    return replace(later, fall=Fall(step, start.position, start.velocity))


def with_exact_masses(record: SceneRecord, start: SceneStart) -> SceneRecord:
    """The record with volume and density in double precision, where it holds restart states to go on from.

    The mass of a particle is their product, rounded once: by the run, not by the file.
    """
    if record.keyframes is None:
        return record
    density = None if start.density is None else start.density.astype(np.float64)
    return replace(record, volume=start.volume.astype(np.float64), density=density)


def going_on_falling(starts: Sequence[SceneStart], batch: SceneBatch) -> tuple[SceneBatch, list[int]]:
    """The batch with scenes that are in the midst of a free fall back at its start, and how many steps ago that was.

    A scene is, where its state is what the fall from there gives, to the last bit; it is 0 steps ago for the others.
    The motion of a fall is computed from its start, so that rounding depends on where that is.
    """
    state, steps = batch.state, [0] * len(starts)
    ends = np.cumsum([len(start.position) for start in starts])
    for scene, (start, end) in enumerate(zip(starts, ends, strict=True)):
        fall, particles = start.fall, slice(int(end) - len(start.position), int(end))
        if fall is None or not _is_undeformed(start):
            continue
        at_start = replace(start, position=fall.position, velocity=fall.velocity)
        alone = batch_scenes([at_start], state.position.dtype, state.position.device)
        now = fallen(alone.state, alone.scenes, start.settings.time_step, [fall.steps])
        fields = ((now.position, state.position), (now.velocity, state.velocity))
        if all(torch.equal(one, whole[:, particles]) for one, whole in fields):
            steps[scene] = fall.steps
            position, velocity = state.position.clone(), state.velocity.clone()
            position[:, particles], velocity[:, particles] = alone.state.position, alone.state.velocity
            state = state._replace(position=position, velocity=velocity)
    return batch._replace(state=state), steps


def _is_undeformed(start: SceneStart) -> bool:
    strained = start.deformation is not None and bool((start.deformation != np.eye(3)).any())
    return not strained and (start.affine is None or not start.affine.any())


def _frames_in_words(frames: np.ndarray) -> str:
    if not len(frames):
        return "files with restart states (keyframe_every= of simulate, deformation=True in Python)"
    more = ", ..." if len(frames) > LISTED else ""
    return f"frames {', '.join(map(str, frames[:LISTED]))}{more}"
