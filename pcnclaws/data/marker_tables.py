"""Tables of markers: a CSV file with a line for each marker of each frame, or for each frame."""

import csv
import logging
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TypeAlias

import numpy as np
from jaxtyping import Float

from pcnclaws.data.csv_files import opened_table
from pcnclaws.errors import UserError

log = logging.getLogger(__name__)

COLUMNS = ("time", "marker", "x", "y", "z")
# Of a table with a line for each frame: names of its time in seconds, and columns such as tip1_x, tip1.X, tip1 z [m].
TIMES = ("time", "time_s", "t", "time [s]", "time (s)", "time (seconds)")
COORDINATE = re.compile(r"(?P<marker>.+)[ _.:](?P<axis>[xyzXYZ])( *[\[(][^\])]*[\])])?")
Places: TypeAlias = dict[tuple[float, str], tuple[float, ...]]


def read_table(path: Path) -> tuple[np.ndarray, list[str], Float[np.ndarray, "frames markers 3"]]:
    """Times, names of the markers in the order of the file, and positions, NaN where a marker was not seen.

    Either a line for each marker of each frame, of the columns `time, marker, x, y, z`, or a line for each frame, with
    the columns `<marker>_x, <marker>_y, <marker>_z` of each marker beside a time.
    """
    with opened_table(path) as file:
        rows = csv.DictReader(file)
        header = [str(name).strip() for name in rows.fieldnames or ()]
        if len(set(header)) < len(header):
            raise UserError(f"{path}: a column is there twice; accepted: the header {','.join(COLUMNS)}")
        markers = _columns_of_markers(path, header)
        times = [name for name in header if name.lower() in TIMES]
        if markers and times:
            places = _read_frames(path, rows, times[0], markers)
            read = [times[0], *(column for columns in markers.values() for column in columns)]
        else:
            missing = [name for name in COLUMNS if name not in header]
            if missing:
                raise UserError(
                    f"{path}: the column '{missing[0]}' is missing; accepted: the header {','.join(COLUMNS)}, "
                    "or time_s and <marker>_x,<marker>_y,<marker>_z for each marker"
                )
            places, read = _read_lines(path, rows), [*COLUMNS]
    others = [name[:60] for name in header if name not in read]
    if others:
        shown = ", ".join(COLUMNS if read == [*COLUMNS] else [read[0], *markers])
        log.warning("%s: not read: the columns %s; read: %s", path, ", ".join(others), shown)
    if not places:
        raise UserError(f"{path}: holds no marker; accepted: lines of {','.join(COLUMNS)}")
    times_seen, names = sorted({time for time, _ in places}), list(dict.fromkeys(name for _, name in places))
    lacking = [place for place in places.values() if 0 < sum(map(math.isfinite, place)) < len(place)]
    if lacking:
        log.warning("%s: %d positions lack a coordinate and are not used", path, len(lacking))
    target = np.full((len(times_seen), len(names), 3), np.nan)
    frame, column = ({key: k for k, key in enumerate(keys)} for keys in (times_seen, names))
    for (time, name), position in places.items():
        if all(map(math.isfinite, position)):
            target[frame[time], column[name]] = position
    return np.array(times_seen), names, target


def _read_lines(path: Path, rows: "csv.DictReader[str]") -> Places:
    """The places of a table with a line for each marker of each frame."""
    places: Places = {}
    latest: dict[str, float] = {}
    for row in rows:
        values = {str(key).strip(): value for key, value in row.items()}
        time, *position = (_number(values[name], name, path, rows.line_num) for name in COLUMNS if name != "marker")
        key = _time(time, path, rows.line_num), str(values["marker"]).strip()
        if key in places and not np.array_equal(places[key], position, equal_nan=True):
            raise UserError(
                f"{path}: line {rows.line_num}: marker {_quoted(key[1])} has a second position at {time:g} s; "
                "accepted: one for each time"
            )
        if time < latest.get(key[1], -math.inf):
            raise _backwards(path, rows.line_num, time, latest[key[1]])
        places[key], latest[key[1]] = tuple(position), time
    return places


def _read_frames(path: Path, rows: "csv.DictReader[str]", of_time: str, markers: Mapping[str, list[str]]) -> Places:
    """The places of a table with a line for each frame."""
    places: Places = {}
    latest = -math.inf
    for row in rows:
        values = {str(key).strip(): value for key, value in row.items()}
        time = _time(_number(values[of_time], of_time, path, rows.line_num), path, rows.line_num)
        if time <= latest:
            raise _backwards(path, rows.line_num, time, latest)
        latest = time
        for marker, columns in markers.items():
            cells = (_number(values[column], column, path, rows.line_num) for column in columns)
            places[time, marker] = tuple(cells)
    return places


def _columns_of_markers(path: Path, header: list[str]) -> dict[str, list[str]]:
    """The columns of x, y and z of each marker, by its name; none of a table that has no such columns."""
    found: dict[str, dict[str, str]] = {}
    for column in header:
        if match := COORDINATE.fullmatch(column):
            found.setdefault(match["marker"].strip(), {})[match["axis"].lower()] = column
    for marker, axes in found.items():
        if lacking := [axis for axis in "xyz" if axis not in axes]:
            raise UserError(f"{path}: marker {_quoted(marker)} has no column of {lacking[0]}; accepted: x, y and z")
    return {marker: [axes[axis] for axis in "xyz"] for marker, axes in found.items()}


def _time(time: float, path: Path, line: int) -> float:
    if not math.isfinite(time):
        raise UserError(f"{path}: line {line} has no time; accepted: seconds since the start")
    return time


def _backwards(path: Path, line: int, time: float, latest: float) -> UserError:
    return UserError(
        f"{path}: line {line}: the time {time:g} s comes after {latest:g} s; accepted: times that increase"
    )


def _quoted(text: str) -> str:
    """The beginning of a cell, on one line."""
    return f"'{text[:40]}'" if text[:40].isprintable() else ascii(text[:40])


def _number(text: str | None, name: str, path: Path, line: int) -> float:
    """The number of a cell; NaN of an empty one."""
    if text is None or not text.strip():
        return math.nan
    try:
        return float(text)
    except ValueError:
        raise UserError(
            f"{path}: line {line}: {name}={_quoted(text)} is not a number; accepted: a number, or empty"
        ) from None
