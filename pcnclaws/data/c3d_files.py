"""Motion capture in C3D files, read by ezc3d: labelled points at the frames of a camera system.

ezc3d gives coordinates in double precision: those that are stored as 16-bit integers as the product with the scale of
the file, those that are stored in single precision as they are. Neither is rounded: a product has 40 bits at most.

source  The C3D File Format User Guide, Motion Lab Systems
"""

import importlib
import logging
import os
import resource
import struct
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from pcnclaws.data.guarded_hdf5 import one_line_faults
from pcnclaws.data.length_units import UNITS, unit_named
from pcnclaws.data.reading_apart import read_apart
from pcnclaws.data.room import require_room
from pcnclaws.errors import UserError, not_installed

log = logging.getLogger(__name__)

ENDING = ".c3d"
# Memory that ezc3d takes for a byte of a file (measured: 28 of integers, half of it in single precision), and for any.
OF_BYTE, OF_ANY = 48, 256 * 1024**2
# Slowest reading that is waited for [bytes/s]; ezc3d reads 3e6 of integers.
SLOWEST = 3e5
# Lists of POINT with the labels of points that are no places but angles, forces and the like.
OTHER_THAN_PLACES = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS")


class Points(NamedTuple):
    """The points of a file.

    time      of each frame, (frame number - 1) / rate [s]
    names     labels of the points
    position  NaN where a point was not seen, in the unit of the file
    units     one of UNITS; None where the file says none
    """

    time: Float[np.ndarray, " frames"]
    names: list[str]
    position: Float[np.ndarray, "frames points 3"]
    units: str | None


def read_c3d(path: Path) -> Points:
    """The points of a C3D file, by ezc3d in a forked child: native code ends no more than that on a damaged file.

    raises  UserError for a file that cannot be read, and where ezc3d is not installed
    """
    if not path.is_file():
        raise UserError(f"{path}: no such file")
    try:
        ezc3d = importlib.import_module("ezc3d")
    except ImportError as error:
        raise not_installed("a C3D file", "ezc3d", "c3d", "a CSV file of the markers") from error
    size = path.stat().st_size
    require_room(OF_BYTE * size, str(path))
    with one_line_faults(str(path)):
        return _points(path, read_apart(path, lambda: _read(ezc3d, path, size), "ezc3d", SLOWEST))


def _points(path: Path, found: Mapping[str, Any]) -> Points:
    """The points of what ezc3d found."""
    labels, position, residual, others = found["labels"], found["points"], found["residuals"], found["others"]
    rate, first = float(found["rate"]), int(found["first_frame"])
    if position.ndim != 3 or position.shape[0] < 3 or residual.shape != (1, *position.shape[1:]) or not position.size:
        raise UserError(f"{path}: holds no points; accepted: a C3D file with places of markers")
    if not (np.isfinite(rate) and rate > 0.0) or first < 0:
        raise UserError(
            f"{path}: frames from {first + 1} on at a rate of {rate:g} a second; accepted: from 1 on, a rate above 0"
        )
    position = np.moveaxis(position[:3], (0, 1, 2), (2, 1, 0)).astype(np.float64)
    seen = np.isfinite(position).all(2) & ~(residual[0].T < 0.0)
    position[~seen] = np.nan
    names = _names(path, [*map(_text, labels)], position.shape[1])
    kept = _places(path, names, {_text(label) for label in others})
    if (said := _frames_of_header(path)) > len(position):
        log.warning("%s: its header says %d frames, and %d are there; is it cut short?", path, said, len(position))
    time = (first + np.arange(len(position))) / rate
    return Points(time, [names[k] for k in kept], position[:, kept], _unit(path, found["units"]))


def units_of(path: Path, said: str | None, units: str | None) -> str:
    """The unit of a file that says one, or none, where `observation.units` says one, or none.

    raises  UserError where neither does
    """
    if units is None and said is None:
        raise UserError(
            f"{path}: does not say its unit of length; accepted: observation.units= one of {', '.join(UNITS)}"
        )
    if units is not None and said not in (None, units):
        log.warning("%s: says that its lengths are in %s; observation.units=%s holds", path, said, units)
    return str(units or said)


def _read(ezc3d: Any, path: Path, size: int) -> dict[str, Any]:
    """What ezc3d finds, as plain values; UserError of one line for what it raises."""
    try:
        with _confined(OF_BYTE * size + OF_ANY):
            file = ezc3d.c3d(str(path))
            header, point = file["header"]["points"], file["parameters"]["POINT"]
            return {
                "points": np.asarray(file["data"]["points"]),
                "residuals": np.asarray(file["data"]["meta_points"]["residuals"]),
                "labels": _listed(point, "LABELS"),
                "others": [label for name in OTHER_THAN_PLACES for label in _listed(point, name)],
                "units": _texts(point, "UNITS")[:1],
                "rate": float(header["frame_rate"]),
                "first_frame": int(header["first_frame"]),
            }
    except Exception as error:  # whatever the bindings make of an exception in C++
        reason = " ".join(str(error).split()) or type(error).__name__
        raise UserError(f"{path}: damaged or unreadable ({_text(reason)[:200]})") from error


def _frames_of_header(path: Path) -> int:
    """The number of frames by the first and the last one of the header: ezc3d gives those that it finds."""
    with path.open("rb") as file:
        first, last = struct.unpack("<6x2H", file.read(10))
    return last - first + 1


def _listed(point: Mapping[str, Any], name: str) -> list[str]:
    """The texts of a parameter and of those that go on where it is full: LABELS, LABELS2, LABELS3, ..."""
    found, more = _texts(point, name), 2
    while f"{name}{more}" in point:
        found += _texts(point, f"{name}{more}")
        more += 1
    return found


def _texts(point: Mapping[str, Any], name: str) -> list[str]:
    """The texts of a parameter of the group POINT, none where it is not there."""
    value = point[name]["value"] if name in point else []
    return [str(one) for one in value] if isinstance(value, list) else []


@contextmanager
def _confined(size: int) -> Iterator[None]:
    """Without output of native code, and without more memory than so many bytes: a header may claim any."""
    limits = resource.getrlimit(resource.RLIMIT_AS)
    used = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * resource.getpagesize()
    sys.stdout.flush()
    sys.stderr.flush()
    kept = [os.dup(1), os.dup(2)]
    silent = os.open(os.devnull, os.O_WRONLY)
    try:
        for stream in (1, 2):
            os.dup2(silent, stream)
        if limits[0] == resource.RLIM_INFINITY or used + size < limits[0]:
            resource.setrlimit(resource.RLIMIT_AS, (used + size, limits[1]))
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, limits)
        for stream, before in zip((1, 2), kept, strict=True):
            os.dup2(before, stream)
            os.close(before)
        os.close(silent)


def _text(text: object) -> str:
    """A text of the file on one line: UTF-8, or Latin-1 of older programs."""
    raw = str(text).encode("utf-8", "surrogateescape")
    try:
        whole = raw.decode("utf-8")
    except UnicodeDecodeError:
        whole = raw.decode("latin-1")
    return "".join(letter if letter.isprintable() else "?" for letter in whole.strip("\0 "))


def _names(path: Path, labels: list[str], count: int) -> list[str]:
    """A name for each point: its label, or its number where it has none; a second one of a label is told apart."""
    names: list[str] = []
    taken = set(labels)
    for number in range(count):
        label = (labels[number] if number < len(labels) else "") or f"point {number + 1}"
        name, more = label, 2
        if label in names:
            while (name := f"{label} ({more})") in taken:
                more += 1
            log.warning("%s: the label '%s' is there twice; point %d is '%s'", path, label[:40], number + 1, name[:50])
        taken.add(name)
        names.append(name)
    return names


def _places(path: Path, names: list[str], others: set[str]) -> list[int]:
    """Numbers of the points that are places."""
    left = [name for name in names if name in others]
    if left:
        log.warning("%s: not read: %s, which the file lists as angles, forces or the like", path, ", ".join(left[:20]))
    kept = [number for number, name in enumerate(names) if name not in others]
    if not kept:
        raise UserError(f"{path}: holds no points; accepted: a C3D file with places of markers")
    return kept


def _unit(path: Path, said: list[Any]) -> str | None:
    """POINT:UNITS as one of UNITS; None where nothing, or nothing that is known, is said."""
    word = _text(said[0]) if said else ""
    unit = unit_named(word)
    if word and unit is None:
        log.warning("%s: says that its lengths are in '%s', which is not known", path, word[:40])
    return unit
