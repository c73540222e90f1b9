"""Frames of unlabelled points from files: a CSV table, arrays of an .npz, or a series of PLY point clouds.

.csv  columns time, x, y, z: a line for each point, those of a frame at the same time
.npz  position (frames, points, 3) with time (frames,), NaN where a frame has fewer points; or position (points, 3) with
      the time of each point, time (points,), or with its frame, frame (points,) from 0, and time (frames,)
.ply  NAME_*.ply, a file for each frame, with a line 'comment time SECONDS' in its header
"""

import csv
import io
import logging
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int64

from pcnclaws.atomic import replaced_file
from pcnclaws.data.csv_files import opened_table
from pcnclaws.data.guarded_npz import opened_arrays
from pcnclaws.data.ply_series import read_cloud_series
from pcnclaws.data.point_cloud_files import write_ply
from pcnclaws.errors import UserError

log = logging.getLogger(__name__)

POINT_FRAMES = (".csv", ".npz", ".ply")
COLUMNS = ("time", "x", "y", "z")
ARRAYS = ("time", "position", "frame")
# A frame needs as many points as a rigid body has places and turns: each point tells one distance.
FEWEST_POINTS = 6
# Significant digits of a CSV file.
DIGITS, TIME_DIGITS = 7, 9


class PointFrames(NamedTuple):
    """Points by frame.

    time      of the frames [s], increasing, (frames,)
    position  [m], or in the unit of the file, (points, 3)
    frame     of each point, increasing, (points,)
    """

    time: Float[np.ndarray, " frames"]
    position: Float[np.ndarray, "points 3"]
    frame: Int64[np.ndarray, " points"]

    def by_frame(self) -> Float[np.ndarray, "frames most 3"]:
        """Positions by frame, NaN where a frame has fewer points than another."""
        return by_frame(self.position, self.frame, len(self.time))


def by_frame(
    values: Float[np.ndarray, "points 3"], frame: Int64[np.ndarray, " points"], frames: int
) -> Float[np.ndarray, "frames most 3"]:
    """Values of points by frame, NaN where a frame has fewer points than another."""
    count = np.bincount(frame, minlength=frames)
    result = np.full((frames, count.max(), 3), np.nan)
    result[frame, np.arange(len(frame)) - np.repeat(np.cumsum(count) - count, count)] = values
    return result


def read_point_frames(path: Path) -> PointFrames:
    """The frames of a file, by its ending.

    raises  UserError, one line, for whatever is wrong with the file, for a point that is not finite, for a frame of too
            few points and for times that run backwards
    """
    readers = {".csv": _from_table, ".npz": _from_arrays, ".ply": _from_clouds}
    if path.suffix.lower() not in readers:
        raise UserError(f"observation.file={path} is not accepted; accepted: points in {', '.join(POINT_FRAMES)}")
    frames = readers[path.suffix.lower()](path)
    _require_points(path, frames)
    return frames


def write_point_frames(path: Path, frames: PointFrames) -> list[Path]:
    """Writes a file that read_point_frames reads, by its ending; of .ply NAME_000.ply, ... The files are returned."""
    if path.suffix.lower() == ".ply":
        return _write_clouds(path, frames)
    with replaced_file(path) as part:
        if path.suffix.lower() == ".npz":
            np.savez_compressed(part, time=frames.time, position=frames.position.astype(np.float32), frame=frames.frame)
        else:
            text = io.StringIO(newline="")
            rows = csv.writer(text)
            rows.writerow(COLUMNS)
            for t, place in zip(frames.time[frames.frame].tolist(), frames.position.tolist(), strict=True):
                rows.writerow((f"{t:.{TIME_DIGITS}g}", *(f"{x:.{DIGITS}g}" for x in place)))
            part.write(text.getvalue().encode())
    return [path]


def _write_clouds(path: Path, frames: PointFrames) -> list[Path]:
    digits = max(len(str(len(frames.time) - 1)), 3)
    files = [path.with_name(f"{path.stem}_{number:0{digits}d}.ply") for number in range(len(frames.time))]
    for number, (file, time) in enumerate(zip(files, frames.time.tolist(), strict=True)):
        place = frames.position[frames.frame == number].astype(np.float32)
        write_ply(file, place, {}, f"time {time:.{TIME_DIGITS}g}")
    return files


def _from_table(path: Path) -> PointFrames:
    with opened_table(path) as file:
        rows = csv.reader(file)
        header = [name.strip() for name in next(rows, [])]
        for name in COLUMNS:
            if header.count(name) != 1:
                what = "is missing" if name not in header else "is there twice"
                raise UserError(f"{path}: the column '{name}' {what}; accepted: the header {','.join(COLUMNS)}")
        _name_unread(path, [name for name in header if name not in COLUMNS])
        place = [header.index(name) for name in COLUMNS]
        table = [_numbers(path, rows.line_num, row, place) for row in rows if any(cell.strip() for cell in row)]
    numbers = np.array(table, dtype=np.float64).reshape(-1, len(COLUMNS))
    return _by_time(path, numbers[:, 0], numbers[:, 1:])


def _numbers(path: Path, line: int, row: list[str], place: list[int]) -> list[float]:
    cells = [row[k].strip() if k < len(row) else "" for k in place]
    try:
        numbers = [float(cell) for cell in cells]
    except ValueError:
        numbers = [math.nan]
    if not all(map(math.isfinite, numbers)):
        shown = ",".join(cells)[:60]
        raise UserError(f"{path}: line {line} holds {shown!a}; accepted: four finite numbers, {','.join(COLUMNS)}")
    return numbers


def _from_arrays(path: Path) -> PointFrames:
    with opened_arrays(path) as file:
        for name in ("time", "position"):
            if name not in file:
                raise UserError(f"{path}: '{name}' is missing; accepted: time and position, of frames or of points")
        arrays = {name: file[name] for name in ARRAYS if name in file}
        _name_unread(path, [name for name in file if name not in ARRAYS])
    for name, values in arrays.items():
        if values.dtype.kind not in ("iu" if name == "frame" else "fiu"):
            raise UserError(f"{path}: '{name}' holds {values.dtype}; accepted: {'whole ' * (name == 'frame')}numbers")
    time, position = arrays["time"].astype(np.float64), arrays["position"].astype(np.float64)
    of_frames = time.ndim == 1 and position.ndim == 3 and position.shape[::2] == (len(time), 3)
    of_points = time.ndim == 1 and position.ndim == 2 and position.shape[1] == 3
    if of_frames and "frame" not in arrays:
        given = ~np.isnan(position).all(2)
        return PointFrames(time, position[given], np.nonzero(given)[0].astype(np.int64))
    if of_points and "frame" in arrays and arrays["frame"].shape == position.shape[:1]:
        return _by_frame(path, time, position, arrays["frame"].astype(np.int64))
    if of_points and "frame" not in arrays and len(time) == len(position):
        return _by_time(path, time, position)
    shapes = ", ".join(f"'{name}' {values.shape}" for name, values in arrays.items())
    raise UserError(
        f"{path}: holds arrays of the shapes {shapes}; accepted: position (frames, points, 3) and time (frames,), or "
        "position (points, 3) and time (points,), or frame (points,) beside both"
    )


def _from_clouds(path: Path) -> PointFrames:
    clouds = read_cloud_series(path)
    counts = [len(cloud.position) for _, cloud in clouds]
    position = np.concatenate([cloud.position.astype(np.float64) for _, cloud in clouds])
    return PointFrames(np.array([time for time, _ in clouds]), position, np.repeat(np.arange(len(clouds)), counts))


def _by_time(path: Path, of_point: np.ndarray, position: np.ndarray) -> PointFrames:
    """Points in the order of a file, each with its time."""
    if not len(of_point):
        raise UserError(f"{path}: holds no point; accepted: points with times [s]")
    back = np.flatnonzero(np.diff(of_point) < 0.0)
    if len(back):
        raise _backwards(path, *of_point[back[0] : back[0] + 2].tolist())
    time, frame = np.unique(of_point, return_inverse=True)
    return PointFrames(time, position, frame.reshape(-1).astype(np.int64))


def _by_frame(path: Path, time: np.ndarray, position: np.ndarray, frame: np.ndarray) -> PointFrames:
    if len(frame) and not 0 <= frame.min() <= frame.max() < len(time):
        raise UserError(f"{path}: 'frame' goes from {frame.min()} to {frame.max()}; accepted: 0 to {len(time) - 1}")
    order = np.argsort(frame, kind="stable")
    return PointFrames(time, position[order], frame[order])


def _require_points(path: Path, frames: PointFrames) -> None:
    """Refuses times that do not increase, points that are not finite, and frames of too few points."""
    time = frames.time
    if not np.isfinite(time).all():
        raise UserError(f"{path}: a time is not a finite number; accepted: seconds")
    back = np.flatnonzero(np.diff(time) <= 0.0)
    if len(back):
        raise _backwards(path, *time[back[0] : back[0] + 2].tolist())
    wrong = np.flatnonzero(~np.isfinite(frames.position).all(1))
    if len(wrong):
        shown = ", ".join(f"{x:g}" for x in frames.position[wrong[0]])
        raise UserError(
            f"{path}: point ({shown}) at {time[frames.frame[wrong[0]]]:g} s is not finite; accepted: finite numbers"
        )
    count = np.bincount(frames.frame, minlength=len(time))
    few = np.flatnonzero(count < FEWEST_POINTS)
    if len(few) or not len(time):
        where = f"the frame at {time[few[0]]:g} s holds {count[few[0]] or 'no'} points" if len(time) else "no frame"
        raise UserError(f"{path}: {where}; accepted: at least {FEWEST_POINTS} in every frame")


def _backwards(path: Path, latest: float, time: float) -> UserError:
    return UserError(f"{path}: the time {time:g} s comes after {latest:g} s; accepted: times that increase")


def _name_unread(path: Path, others: list[str]) -> None:
    if others:
        log.warning("%s: not read: %s", path, ", ".join(ascii(name[:60])[1:-1] for name in others[:8]))
