"""Tables of markers: a CSV file with a line for each marker of each frame."""

import csv
import logging
import math
from pathlib import Path

import numpy as np
from jaxtyping import Float

from pcnclaws.errors import UserError

log = logging.getLogger(__name__)

COLUMNS = ("time", "marker", "x", "y", "z")


def read_table(path: Path) -> tuple[np.ndarray, list[str], Float[np.ndarray, "frames markers 3"]]:
    """Times, names of the markers in the order of the file, and positions."""
    if not path.is_file():
        raise UserError(f"{path}: no such file")
    places: dict[tuple[float, str], tuple[float, ...]] = {}
    with path.open(newline="", encoding="utf-8-sig", errors="replace") as file:
        rows = csv.DictReader(file)
        header = [str(name).strip() for name in rows.fieldnames or ()]
        missing = [name for name in COLUMNS if name not in header]
        if missing:
            raise UserError(f"{path}: the column '{missing[0]}' is missing; accepted: the header {','.join(COLUMNS)}")
        others = [name[:60] for name in header if name not in COLUMNS]
        if others:
            log.warning("%s: not read: the columns %s; read: %s", path, ", ".join(others), ", ".join(COLUMNS))
        if len(set(header)) < len(header):
            raise UserError(f"{path}: a column is there twice; accepted: the header {','.join(COLUMNS)}")
        for row in rows:
            values = {str(key).strip(): value for key, value in row.items()}
            time, *position = (_number(values[name], name, path, rows.line_num) for name in COLUMNS if name != "marker")
            if not math.isfinite(time):
                raise UserError(f"{path}: line {rows.line_num} has no time; accepted: seconds since the start")
            key = time, str(values["marker"]).strip()
            if key in places and not np.array_equal(places[key], position, equal_nan=True):
                raise UserError(
                    f"{path}: line {rows.line_num}: marker {_quoted(key[1])} has a second position at {time:g} s; "
                    "accepted: one for each time"
                )
            places[key] = tuple(position)
    if not places:
        raise UserError(f"{path}: holds no marker; accepted: lines of {','.join(COLUMNS)}")
    times, names = sorted({time for time, _ in places}), list(dict.fromkeys(name for _, name in places))
    lacking = [place for place in places.values() if 0 < sum(map(math.isfinite, place)) < len(place)]
    if lacking:
        log.warning("%s: %d positions lack a coordinate and are not used", path, len(lacking))
    target = np.full((len(times), len(names), 3), np.nan)
    frame, column = ({key: k for k, key in enumerate(keys)} for keys in (times, names))
    for (time, name), position in places.items():
        if all(map(math.isfinite, position)):
            target[frame[time], column[name]] = position
    return np.array(times), names, target


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
