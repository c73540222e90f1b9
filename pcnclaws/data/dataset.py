"""Training segments: short pieces of recorded trajectories, many of them as one flat batch."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.utils.data import Dataset

from pcnclaws.data.records import SceneRecord
from pcnclaws.data.scenes import SceneStart, batch_scenes, group_by_settings, join_positions, start_of
from pcnclaws.errors import UserError, unknown_name
from pcnclaws.mpm.state import ParticleState, Scenes

STARTS = ("keyframes", "initial")


class SegmentBatch(NamedTuple):
    """Segments of the same number of steps and the same settings, concatenated.

    state       where the segments begin
    scenes      one scene for each segment
    parameters  physical parameters by name, each (particles,)
    target      recorded positions [m] after every, 2 every, ... steps, (frames, 3, particles), NaN = unobserved
    steps       length of the segments
    every       steps from one frame to the next
    group       which of the data set's settings the segments have
    """

    state: ParticleState
    scenes: Scenes
    parameters: dict[str, Tensor]
    target: Float[Tensor, "frames 3 particles"]
    steps: int
    every: int
    group: int


@dataclass(frozen=True)
class SegmentPlan:
    """How the segments of a run are chosen.

    iterations       number of batches, 0 for none
    segments         segments of a batch; None: so many as cover the motion of a scene, one after the other
    start            'keyframes': segments begin at recorded full states; 'initial': at the first frame with F = I and
                     C = 0 (or the file's keyframe at step 0), which needs positions only
    first, last      length of the segments [steps] at the first and the last iteration; None: 25 and 200 from
                     keyframes, half of the motion and all of it from the initial state
    frame_every      steps between the frames that enter the loss; None: every recorded frame
    seed             batch i depends on (seed, i) alone
    """

    iterations: int
    segments: int | None = 8
    start: str = "keyframes"
    first: int | None = None
    last: int | None = None
    frame_every: int | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        if self.start not in STARTS:
            raise unknown_name("training.start", self.start, STARTS)
        for option, value, least in (
            ("iterations", self.iterations, 0),
            ("batch_segments", self.segments, 1),
            ("segment_length.first", self.first, 1),
            ("segment_length.last", self.last, 1),
            ("loss_every", self.frame_every, 1),
        ):
            if value is not None and (isinstance(value, bool) or not isinstance(value, int) or value < least):
                raise UserError(f"training.{option}={value} is not accepted; accepted: a whole number from {least}")

    def length(self, iteration: int, every: int, duration: int) -> int:
        """Length of the segments at an iteration [steps]: a multiple of `every`, at most `duration`.

        Grows from first to last by half a period of a cosine.
        """
        from_start = self.start == "initial"
        first = self.first or (duration // 2 if from_start else 25)
        last = self.last or (duration if from_start else 200)
        progress = iteration / max(self.iterations - 1, 1)
        length = first + (last - first) * 0.5 * (1.0 - math.cos(math.pi * progress))
        return min(max(round(length / every), 1), duration // every) * every


class Timeline:
    """A recorded scene on the axis of its steps: which step each frame shows and where segments may begin."""

    def __init__(self, record: SceneRecord, start: str) -> None:
        self.record = record
        self.step = record.frame_steps()
        self.start = start_of(record)
        if len(self.step) < 2:
            raise UserError(f"{record.label}: one frame shows no motion; training needs at least two")
        if start == "initial" or record.keyframes is None:
            self.restarts = np.zeros(1, dtype=np.int64)
        else:
            self.restarts = record.keyframes.step[record.keyframes.step < self.duration]

    @property
    def duration(self) -> int:
        """Steps from the first frame to the last one."""
        return int(self.step[-1])

    def begin(self, step: int) -> SceneStart:
        """The recorded state at one of the restarts."""
        keyframes = self.record.keyframes
        if keyframes is None or step == 0:
            return self.start
        k = int(np.flatnonzero(keyframes.step == step)[0])
        return replace(
            self.start,
            position=keyframes.position[k],
            velocity=keyframes.velocity[k],
            affine=keyframes.affine[k],
            deformation=keyframes.deformation[k],
        )

    def frames(self, first: int, length: int, every: int) -> np.ndarray:
        """Positions [m] at first + every, first + 2 every, ..., (frames, particles, 3), NaN where not recorded."""
        wanted = np.arange(first + every, first + length + 1, every)
        found = np.minimum(np.searchsorted(self.step, wanted), len(self.step) - 1)
        positions = np.asarray(self.record.position[found], dtype=np.float32)
        positions[self.step[found] != wanted] = np.nan
        return positions


class SegmentDataset(Dataset[SegmentBatch]):
    """Batch i of a training run, a pure function of the plan and i: a resumed run sees what any other sees."""

    def __init__(self, records: Sequence[SceneRecord], plan: SegmentPlan, dtype: torch.dtype = torch.float32) -> None:
        self.plan, self.dtype = plan, dtype
        groups = group_by_settings(records)
        self.settings = [group[0].settings for group in groups]
        self.groups = [[Timeline(record, plan.start) for record in group] for group in groups]
        self.every = [_frame_spacing(group, plan.frame_every) for group in self.groups]

    def __len__(self) -> int:
        return self.plan.iterations

    def __getitem__(self, iteration: int) -> SegmentBatch:
        random = np.random.default_rng((self.plan.seed, iteration))
        sizes = np.array([len(group) for group in self.groups])
        g = int(random.choice(len(sizes), p=sizes / sizes.sum()))
        group, every = self.groups[g], self.every[g]
        length = self.plan.length(iteration, every, min(timeline.duration for timeline in group))

        if self.plan.segments is None:
            timeline = group[int(random.integers(len(group)))]
            begins = _end_to_end(timeline, length)
            chosen = [timeline] * len(begins)
        else:
            chosen = [group[scene] for scene in _spread(random, len(group), self.plan.segments)]
            begins = _begins(random, chosen, length)
        batch = batch_scenes([timeline.begin(b) for timeline, b in zip(chosen, begins, strict=True)], self.dtype, "cpu")
        frames = [timeline.frames(b, length, every) for timeline, b in zip(chosen, begins, strict=True)]
        return SegmentBatch(
            batch.state, batch.scenes, batch.parameters, join_positions(frames, self.dtype), length, every, g
        )


def _frame_spacing(group: Sequence[Timeline], wanted: int | None) -> int:
    """Steps between the frames of the loss: the largest spacing that meets every recorded frame, or the wanted one."""
    recorded = math.gcd(*(int(step) for timeline in group for step in np.diff(timeline.step)))
    if wanted is None:
        return recorded
    if wanted % recorded:
        raise UserError(
            f"training.loss_every={wanted} is not accepted; "
            f"accepted: a multiple of the {recorded} steps between the recorded frames"
        )
    return wanted


def _spread(random: np.random.Generator, count: int, wanted: int) -> np.ndarray:
    """Random scene numbers, (wanted,), that use every scene before one comes again."""
    rounds = -(-wanted // count)
    return np.concatenate([random.permutation(count) for _ in range(rounds)])[:wanted]


def _end_to_end(timeline: Timeline, length: int) -> list[int]:
    """Restarts that cover the motion with segments of `length`, each from the last full state that leaves no gap.

    The last segment may reach beyond the motion: nothing is observed there.
    """
    begins = [0]
    while begins[-1] + length < timeline.duration:
        reached = timeline.restarts[timeline.restarts <= begins[-1] + length]
        begins.append(int(reached[-1]))
        if begins[-1] == begins[-2]:
            return begins[:-1]
    return begins


def _begins(random: np.random.Generator, chosen: Sequence[Timeline], length: int) -> list[int]:
    """A random restart for each segment, spread evenly over the part of the motion that leaves room for `length`."""
    places = (random.permutation(len(chosen)) + random.random(len(chosen))) / len(chosen)
    begins = []
    for timeline, place in zip(chosen, places, strict=True):
        possible = timeline.restarts[timeline.restarts + length <= timeline.duration]
        begins.append(int(possible[int(place * len(possible))]) if len(possible) else 0)
    return begins
