"""Segment plan of a training: how many segments, how long, and of which scenes."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pcnclaws.data.timeline import Timeline
from pcnclaws.errors import UserError, unknown_name

STARTS = ("keyframes", "initial")
# At most so many scenes are named in a note.
NAMED = 6


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


class SegmentGroup:
    """Recorded scenes of the same settings, whose segments can share a batch.

    every       steps between the frames of the loss
    longest     of the planned segments [steps]
    informative for each scene, the steps of its shortest segment that shows more than free flight; None where none
                does, from keyframes also where none of `longest` does
    """

    def __init__(self, timelines: Sequence[Timeline], plan: SegmentPlan) -> None:
        self.timelines, self.plan = list(timelines), plan
        self.every = _frame_spacing(timelines, plan.frame_every)
        self.longest = max(self._planned(iteration) for iteration in (0, max(plan.iterations - 1, 0)))
        # from keyframes that is a question to every restart, and those after the first contact answer it at once
        within = self.longest if plan.start == "keyframes" else None
        self.informative = [timeline.free_flight(self.every, within) for timeline in timelines]

    @property
    def shortest(self) -> int | None:
        """Steps of the shortest segment that shows more than free flight; None if no planned one does."""
        return min((n for n in self.informative if n is not None and n <= self.longest), default=None)

    def length(self, iteration: int) -> int:
        """Length of the segments at an iteration [steps]: as planned, from the initial state at least `shortest`."""
        planned = self._planned(iteration)
        return planned if self.plan.start == "keyframes" else max(planned, self.shortest or 0)

    def drawn(self, length: int) -> list[Timeline]:
        """The scenes that segments of this length are drawn from."""
        if self.plan.start == "keyframes":
            return self.timelines
        scenes = zip(self.timelines, self.informative, strict=True)
        return [timeline for timeline, steps in scenes if steps is not None and steps <= length]

    def _planned(self, iteration: int) -> int:
        # a motion that is shorter than its segments is not observed at their ends
        return self.plan.length(iteration, self.every, max(timeline.duration for timeline in self.timelines))


def notes_on_free_flight(groups: Sequence[SegmentGroup]) -> tuple[str, ...]:
    """What free flight leaves of the plan, one line each.

    raises  UserError where it leaves nothing
    """
    if all(group.shortest is None for group in groups):
        raise UserError(_refusal(groups))
    if groups[0].plan.start == "keyframes":
        return ()
    notes = []
    for group in groups:
        planned, begun = group.plan.length(0, group.every, group.longest), group.length(0)
        if begun > planned:
            notes.append(f"segments begin with {begun} steps instead of {planned}: shorter ones show free flight alone")
    left_out = [
        timeline.record.name
        for group in groups
        for timeline in group.timelines
        if all(timeline is not drawn for drawn in group.drawn(group.longest))
    ]
    if left_out:
        names = ", ".join(left_out[:NAMED]) + (", ..." if len(left_out) > NAMED else "")
        longest = max(group.longest for group in groups)
        notes.append(f"not trained on, since they show free flight alone for {longest} steps: {names}")
    return tuple(notes)


def _refusal(groups: Sequence[SegmentGroup]) -> str:
    """Why nothing can be learned, and which length would do."""
    found = [
        (steps, timeline.record.name)
        for group in groups
        for timeline in group.timelines
        if (steps := timeline.free_flight(group.every)) is not None
    ]
    if not found:
        return (
            "the recorded motions are free flight from beginning to end, which is the same with every law; "
            "accepted: recordings that go on until a wall or stress acts on the bodies"
        )
    longest, (steps, name) = max(group.longest for group in groups), min(found)
    return (
        f"training.segment_length.last={longest} is not accepted: segments of so many steps show free flight alone, "
        f"which is the same with every law; accepted: from {steps}, when scene '{name}' leaves free flight"
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
