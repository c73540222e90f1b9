"""The recordings of the measured beam: markers on its tip and on the clamp, in metres and seconds."""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

FOLDER = Path(__file__).with_name("measured")
GRAVITY_FILE, LOADED_FILE = FOLDER / "beam_gravity_V2_a.csv", FOLDER / "beam_load52_V2_a.csv"
MARKERS = [f"{part}{k}" for part in ("tip", "base") for k in (1, 2, 3)]
COLUMNS = ["time_s", *(f"{marker}_{axis}" for marker in MARKERS for axis in "xyz")]
# What the first markers of the tip and of the clamp's face moves by before the release [m].
STILL = 1.5e-4
GRAVITY = 9.81
# The first turn is within so long after the release [s].
FALL = 0.25
# Of the end of a recording [s].
ENDED = 1.0


@dataclass(frozen=True)
class Recording:
    """Markers over time; x points up, z along the beam away from the clamp.

    time  [s], (frames,)
    tip   three markers on the tip [m], (frames, 3, 3)
    base  three markers on the clamp [m], (frames, 3, 3)
    """

    time: np.ndarray
    tip: np.ndarray
    base: np.ndarray

    @property
    def first_moved(self) -> int:
        """The first frame in which the first marker of the tip has moved."""
        height = self.tip[:, 0, 0]
        return int(np.argmax(np.abs(height - np.median(height[:30])) > STILL))

    @property
    def onset(self) -> float:
        """When the beam was let go [s]: the tip falls freely until the first frame that shows it."""
        frame = self.first_moved
        fallen = self.rest[0, 0] - self.tip[frame, 0, 0]
        return float(self.time[frame] - np.sqrt(2.0 * max(fallen, 0.0) / GRAVITY))

    @property
    def first_turn(self) -> tuple[float, float]:
        """When the first marker of the tip first turns [s], and its height then above its start [m], by a parabola."""
        height = self.tip[:, 0, 0] - self.rest[0, 0]
        frame = int(np.argmin(height[self.time < self.onset + FALL]))
        return lowest(self.time[frame - 1 : frame + 2], height[frame - 1 : frame + 2])

    @property
    def rest(self) -> np.ndarray:
        """Places of the markers of the tip before the release [m], (3, 3)."""
        return self.tip[: self.first_moved - 1].mean(0)

    @property
    def base_rest(self) -> np.ndarray:
        """Places of the markers of the clamp before the release [m], (3, 3)."""
        return self.base[: self.first_moved - 1].mean(0)

    @property
    def clamp_slip(self) -> float:
        """How far the second marker of the clamp, on its upper side, ends along the beam from its start [m]."""
        end = self.time > self.time[-1] - ENDED
        return float(self.base[end, 1, 2].mean() - self.base_rest[1, 2])

    def places(self, face: float, axis: float) -> np.ndarray:
        """Places of the markers of the tip in the frame of the undeformed beam [m], (3, 3).

        The second and third stick to its sides, at one distance.
        face  z of the face of the clamp [m]
        axis  x of the axis of the beam [m]
        """
        return self.rest - np.array((axis, 0.5 * (self.rest[1, 1] + self.rest[2, 1]), face))


def read(path: Path) -> Recording:
    """The recording of a file."""
    with path.open(encoding="utf-8", newline="") as file:
        head, *rows = csv.reader(file)
    if head != COLUMNS:
        raise ValueError(f"{path.name} has other columns")
    numbers = np.asarray(rows, dtype=np.float64)
    places = numbers[:, 1:].reshape(-1, 6, 3)
    return Recording(numbers[:, 0], places[:, :3], places[:, 3:])


def lowest(time: np.ndarray, height: np.ndarray) -> tuple[float, float]:
    """Time [s] and height [m] of the vertex of a parabola through three points."""
    square, slope, height_there = np.polyfit(time - time[1], height, 2).tolist()
    return float(time[1]) - slope / (2.0 * square), height_there - slope**2 / (4.0 * square)


def clamp_moved(first: Recording, second: Recording) -> np.ndarray:
    """By how much the clamp is elsewhere in the second recording [m], (3,), from the two markers that stay in place."""
    return (second.base_rest - first.base_rest)[[0, 2]].mean(0)
