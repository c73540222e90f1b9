"""Training segments: short pieces of recorded trajectories, many of them as one flat batch."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.utils.data import Dataset

from pcnclaws.data.segments import SegmentGroup, SegmentPlan, notes_on_free_flight
from pcnclaws.data.timeline import Timeline
from pcnclaws.errors import UserError
from pcnclaws.laws.internal_variables import InternalVariable
from pcnclaws.simulation.batch import SceneBatch, batch_scenes
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.simulation.scenes import SceneStart, group_by_settings
from pcnclaws.tensors.layout import join_positions


class Share(NamedTuple):
    """What one of several processes has of a batch, times their number: 1 for the only one.

    With these as factors of means over its segments and its observations, the mean over processes is that of the batch.
    """

    segments: float = 1.0
    observations: float = 1.0


class SegmentBatch(NamedTuple):
    """Segments of the same number of steps and the same settings, concatenated.

    start   where the segments begin, one scene for each
    target  recorded positions [m] after every, 2 every, ... steps, (frames, 3, particles), NaN = unobserved
    steps   length of the segments
    every   steps from one frame to the next
    group   which of the data set's settings the segments have
    start_time  of all segments, where their surroundings change with time [s], else that of the settings
    share   of the batch, where it is divided among processes
    """

    start: SceneBatch
    target: Float[Tensor, "frames 3 particles"]
    steps: int
    every: int
    group: int
    start_time: float = 0.0
    share: Share = Share()


class SegmentDataset(Dataset[SegmentBatch]):
    """Batch i of a training run, a pure function of the plan and i: a resumed run sees what any other sees.

    From the initial state, segments that show free flight alone are not drawn, since they are the same with every
    law, and where a batch could hold no other, its segments are longer than planned. From keyframes, where most
    segments show more, none is left out.

    internal_variables  of the laws that are trained, which restart states may hold; none unless they are set
    process  number of this process among those that divide each batch, and their number
    of_iteration  batches of an iteration, whose segments are equally long
    notes   what the user should know about the choice of segments, one line each
    raises  UserError where free flight is all that any segment shows
    """

    def __init__(self, records: Sequence[SceneRecord], plan: SegmentPlan, dtype: torch.dtype = torch.float32) -> None:
        self.plan, self.dtype = plan, dtype
        self.internal_variables: Sequence[InternalVariable] = ()
        self.process, self.of_iteration = (0, 1), 1
        timelines = [[Timeline(record, plan.start) for record in group] for group in group_by_settings(records)]
        self.settings = [group[0].record.settings for group in timelines]
        self.groups = [SegmentGroup(group, plan) for group in timelines]
        self.notes = notes_on_free_flight(self.groups) if plan.iterations else ()
        if plan.segments is None and any(settings.changes for settings in self.settings):
            raise UserError(
                "training.batch_segments=null is not possible where colliders move or loads act: segments of a batch "
                "begin at one time; accepted: a number of segments"
            )

    def __len__(self) -> int:
        return self.plan.iterations * self.of_iteration

    @property
    def lengths(self) -> tuple[int, int]:
        """Shortest and longest segments of the run [steps]."""
        ends = [group.length(n) for group in self.groups for n in (0, max(self.plan.iterations - 1, 0))]
        return min(ends), max(ends)

    def __getitem__(self, i: int) -> SegmentBatch:
        random = np.random.default_rng((self.plan.seed, i))
        lengths = [group.length(i // self.of_iteration) for group in self.groups]
        drawn = [group.drawn(length) for group, length in zip(self.groups, lengths, strict=True)]
        sizes = np.array([len(timelines) for timelines in drawn])
        g = int(random.choice(len(sizes), p=sizes / sizes.sum()))
        timelines, length, every = drawn[g], lengths[g], self.groups[g].every

        if self.plan.segments is None:
            timeline = timelines[int(random.integers(len(timelines)))]
            begins = _end_to_end(timeline, length)
            chosen = [timeline] * len(begins)
        else:
            chosen = [timelines[scene] for scene in _spread(random, len(timelines), self.plan.segments)]
            begins = _begins(random, chosen, length)
            if self.settings[g].changes:
                begins, chosen = _at_one_time(begins, chosen)
        starts = [timeline.begin(b) for timeline, b in zip(chosen, begins, strict=True)]
        frames = [timeline.frames(b, length, every) for timeline, b in zip(chosen, begins, strict=True)]
        start_time = starts[0].settings.start_time
        starts, frames, share = self._divided(starts, frames)
        batch = batch_scenes(starts, self.dtype, "cpu", self.internal_variables)
        positions = join_positions(frames, self.dtype)
        return SegmentBatch(batch, positions, length, every, g, start_time=start_time, share=share)

    def _divided(
        self, starts: list[SceneStart], frames: list[np.ndarray]
    ) -> tuple[list[SceneStart], list[np.ndarray], Share]:
        """What this process has of a batch: every n-th segment, or, where there are fewer, one that counts nothing."""
        number, count = self.process
        if count == 1:
            return starts, frames, Share()
        seen = [int(np.isfinite(positions).sum()) for positions in frames]
        segments = count * len(starts[number::count]) / len(starts)
        observations = count * sum(seen[number::count]) / max(sum(seen), 1)
        own = slice(number, None, count) if segments else slice(1)
        return starts[own], frames[own], Share(segments, observations)


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


def _at_one_time(begins: Sequence[int], chosen: Sequence[Timeline]) -> tuple[list[int], list[Timeline]]:
    """Segments that begin when the first one does, of the scenes with a restart then: what moves is in one place."""
    begin = begins[0]
    kept = [timeline for timeline in chosen if begin in timeline.restarts]
    return [begin] * len(kept), kept


def _begins(random: np.random.Generator, chosen: Sequence[Timeline], length: int) -> list[int]:
    """A random restart for each segment, spread evenly over the part of the motion that leaves room for `length`."""
    places = (random.permutation(len(chosen)) + random.random(len(chosen))) / len(chosen)
    begins = []
    for timeline, place in zip(chosen, places, strict=True):
        possible = timeline.restarts[timeline.restarts + length <= timeline.duration]
        begins.append(int(possible[int(place * len(possible))]) if len(possible) else 0)
    return begins
