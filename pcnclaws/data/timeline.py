"""Timeline of a recorded scene in steps: where segments may begin, and what they show."""

from dataclasses import replace

import numpy as np

from pcnclaws.errors import UserError
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.simulation.scenes import SceneStart, start_of

# What a position of the unit box loses where each step rounds it in the same direction [m per step].
ROUNDING = 0.5 * float(np.finfo(np.float32).eps)


class Timeline:
    """A recorded scene on the axis of its steps: which step each frame shows and where segments may begin.

    start  SegmentPlan.start
    """

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
        settings = self.start.settings
        return replace(
            self.start,
            settings=replace(settings, start_time=settings.time_at(step)) if settings.changes else settings,
            loaded_at=self.start.position if settings.loads else None,
            position=keyframes.position[k],
            velocity=keyframes.velocity[k],
            affine=keyframes.affine[k],
            deformation=keyframes.deformation[k],
        )

    def frames(self, first: int, length: int, every: int) -> np.ndarray:
        """Positions [m] at first + every, first + 2 every, ..., (frames, particles, 3), NaN where not recorded."""
        wanted = np.arange(first + every, first + length + 1, every)
        found = np.minimum(np.searchsorted(self.step, wanted), len(self.step) - 1)
        positions = self.record.position[found]
        positions[self.step[found] != wanted] = np.nan
        return positions

    def free_flight(self, every: int, longest: int | None = None) -> int | None:
        """Steps of the shortest segment that shows more than free flight, from whichever restart.

        every    steps between the frames that are looked at
        longest  of the segments [steps], None for the whole motion
        returns  None where free flight is all that such segments show: they are the same with every law
        """
        until = self.duration if longest is None else longest
        lengths = (self._free_flight_from(int(restart), every, until) for restart in self.restarts)
        return min((length for length in lengths if length is not None), default=None)

    def _free_flight_from(self, restart: int, every: int, longest: int) -> int | None:
        """Steps from a restart to the first frame that free flight does not explain.

            x_n = x_0 + n dt v_0 + dt^2 n (n + 1) / 2 g,

        the free flight of the simulation's own steps dt; None if there is no such frame.
        """
        start, time_step = self.begin(restart), self.record.settings.time_step
        position, velocity = start.position.astype(np.float64), start.velocity.astype(np.float64)
        gravity = np.array(self.record.settings.gravity)
        for frame in np.flatnonzero((self.step > restart) & (self.step <= restart + longest)):
            n = int(self.step[frame]) - restart
            if n % every:
                continue
            flown = position + n * time_step * velocity + 0.5 * time_step**2 * n * (n + 1) * gravity
            distance = self.record.position[frame] - flown
            observed = np.isfinite(distance)
            if observed.any() and np.sqrt(np.square(distance[observed]).mean()) > n * ROUNDING:
                return n
        return None
