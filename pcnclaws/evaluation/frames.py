"""Frame alignment: on which steps the frames of a record lie, and predictions at these frames."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.records import TIME_TOLERANCE, SceneRecord
from pcnclaws.simulation.scenes import start_of
from pcnclaws.simulation.time_step import stability_of


def step_plans(records: Sequence[SceneRecord]) -> dict[FramePlan, list[int]]:
    """The indices of the records by what to simulate for them."""
    plans: dict[FramePlan, list[int]] = {}
    for index, record in enumerate(records):
        plans.setdefault(_plan(record), []).append(index)
    return plans


def at_frames_of(record: SceneRecord, run: SceneRecord, every: int) -> SceneRecord:
    """The run, whose frames lie `every` steps apart, with the frames of the record; its keyframes stay.

    A frame that lies between two steps is the linear interpolation of the two.
    """
    place = _places(record) / every
    below = np.floor(place).astype(np.int64)
    above = np.minimum(below + 1, len(run.position) - 1)
    position = run.position
    share = (place - below).astype(position.dtype)[:, None, None]
    at_frames = np.where(share > 0.0, (1.0 - share) * position[below] + share * position[above], position[below])
    return replace(record, position=at_frames, velocity=None, keyframes=run.keyframes)


def in_time_step(record: SceneRecord, time_step: float) -> SceneRecord:
    """The record with another time step [s], its keyframes counted in it; those that lie between its steps go."""
    keyframes = record.keyframes
    if keyframes is not None:
        place = keyframes.step * (record.settings.time_step / time_step)
        step = np.rint(place).astype(np.int64)
        met = np.abs(place - step) <= TIME_TOLERANCE
        keyframes = replace(keyframes, step=step).at(np.flatnonzero(met)) if met.any() else None
    return replace(record, settings=replace(record.settings, time_step=time_step), keyframes=keyframes)


def in_automatic_time_step(record: SceneRecord) -> SceneRecord:
    """The record with the settings of a time step of its own: the longest of CFL number 0.4 that meets its frames.

    Keyframes are met, too. Where the frames lie between the steps of the record anyway, the longest of all.
    """
    step, places = stability_of(start_of(record)).automatic_time_step, _places(record)
    if places[-1] > 0.0 and _all_whole(places):
        spacing = math.gcd(*places.astype(np.int64).tolist(), *_keyframe_steps(record)) * record.settings.time_step
        step = spacing / math.ceil(spacing / step)
    return in_time_step(record, step)


def _plan(record: SceneRecord) -> FramePlan:
    places = _places(record)
    steps = math.ceil(places[-1])
    keyframes = [step for step in _keyframe_steps(record) if step <= steps]
    every = math.gcd(*places.astype(np.int64).tolist(), *keyframes) if _all_whole(places) else 1
    return FramePlan(steps, max(every, 1), math.gcd(*keyframes))


def _places(record: SceneRecord) -> Float[np.ndarray, " frames"]:
    """Where the frames lie, in steps after the first one; whole numbers if all are, but for rounded times."""
    places = (record.time - record.time[0]) / record.settings.time_step
    whole = np.rint(places)
    return whole if np.abs(places - whole).max() <= TIME_TOLERANCE else places


def _all_whole(places: Float[np.ndarray, " frames"]) -> bool:
    return bool((places == np.rint(places)).all())


def _keyframe_steps(record: SceneRecord) -> list[int]:
    return [] if record.keyframes is None else record.keyframes.step.tolist()
