"""Trajectories from a series of PLY point clouds."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pcnclaws.data.frame_records import READ, Frame, checked_fields, joined_components, name_unread, record_of
from pcnclaws.data.room import require_room
from pcnclaws.data.scene_notes import notes_in_line
from pcnclaws.errors import UserError
from pcnclaws.simulation.records import SceneRecord

TYPES = {
    "char": "i1",
    "uchar": "u1",
    "short": "i2",
    "ushort": "u2",
    "int": "i4",
    "uint": "u4",
    "float": "f4",
    "double": "f8",
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "float32": "f4",
    "float64": "f8",
}
ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}
LONGEST_HEADER = 2**16
MOST_FILES = 100_000


def read_ply_series(path: Path, material: str) -> SceneRecord:
    """The scene of the files NAME_*.ply, in the order of their numbers.

    Each holds vertices x, y, z [m], volume [m^3] and, optionally, velocity_0, ..., density, id and physical parameters
    as properties, and in its header a line 'comment time SECONDS', or the line of our own export.
    raises  UserError, one line, for whatever is wrong with a file
    """
    files = _series(path)
    unread: list[str] = []
    frames = [_frame(file, unread) for file in files]
    name_unread(path, unread)
    return record_of(frames, path, path.stem.replace("*", "").strip("_-. ") or "series", material)


def read_cloud_series(path: Path) -> list[tuple[float, "Cloud"]]:
    """Times [s] and point clouds of the files NAME_*.ply, in the order of their numbers.

    raises  UserError, one line, for whatever is wrong with a file
    """
    clouds = [(file, read_ply(file)) for file in _series(path)]
    return [(_time(file, cloud), cloud) for file, cloud in clouds]


def _series(path: Path) -> list[Path]:
    """The files of a series, in the order of their numbers."""
    if "*" not in path.name:
        raise UserError(f"{path}: is one frame; accepted: the series, such as {path.stem.rstrip('0123456789')}*.ply")
    if "*" in str(path.parent) or not path.parent.is_dir():
        raise UserError(f"{path}: no such file")
    files = sorted(path.parent.glob(path.name), key=_number)
    if not 1 <= len(files) <= MOST_FILES:
        raise UserError(f"{path}: matches {len(files)} files; accepted: 1 to {MOST_FILES}")
    require_room(sum(file.stat().st_size for file in files), str(path))
    return files


def _number(path: Path) -> tuple[list[int], str]:
    return [int(digits) for digits in re.findall(r"\d+", path.stem)][-1:], path.name


def _frame(path: Path, unread: list[str]) -> Frame:
    cloud = read_ply(path)
    unread += cloud.unread
    return Frame(_time(path, cloud), cloud.position, cloud.fields, cloud.notes)


def _time(path: Path, cloud: "Cloud") -> float:
    if "time" not in cloud.notes:
        raise UserError(f"{path}: does not say its time; accepted: a line 'comment time SECONDS' in its header")
    return _seconds(cloud.notes["time"], path)


class Cloud(NamedTuple):
    """A point cloud: positions, the fields that are read, what its comments say of the scene, names of other fields."""

    position: np.ndarray
    fields: Mapping[str, np.ndarray]
    notes: Mapping[str, Any]
    unread: Sequence[str]


def read_ply(path: Path) -> Cloud:
    """The vertices of a PLY file.

    raises  UserError, one line, for whatever is wrong with it
    """
    require_room(path.stat().st_size, str(path))
    content = path.read_bytes()
    end = content.find(b"end_header", 0, LONGEST_HEADER)
    line_end = content.find(b"\n", end)
    if not content.startswith(b"ply") or end < 0 or line_end < 0:
        raise UserError(f"{path}: not a PLY file, or damaged; accepted: a PLY point cloud")
    header = [line.strip() for line in content[:end].decode("ascii", errors="replace").splitlines()]
    order, count, properties = _layout(path, header)
    table = _table(path, content[line_end + 1 :], order, count, properties)
    for name in "xyz":
        if name not in table:
            raise UserError(f"{path}: the property '{name}' is missing; accepted: vertices with x, y, z")
    fields = joined_components(table)
    unread = [name for name in fields if name not in (*READ, *"xyz")]
    position = np.stack([table[name] for name in "xyz"], axis=1)
    return Cloud(position, checked_fields(fields, count, str(path)), _notes(path, header), unread)


def _notes(path: Path, header: Sequence[str]) -> dict[str, Any]:
    notes: dict[str, Any] = {}
    for line in header:
        if line.startswith("comment "):
            notes |= notes_in_line(line.removeprefix("comment "), str(path))
            words = line.split()
            if len(words) == 3 and words[1] == "time":
                notes["time"] = words[2]
    return notes


def _seconds(value: object, path: Path) -> float:
    try:
        return float(value)  # pyright: ignore[reportArgumentType]
    except (TypeError, ValueError):
        raise UserError(f"{path}: its time is {str(value)[:40]!a}; accepted: a number [s]") from None


def _layout(path: Path, header: list[str]) -> tuple[str, int, list[tuple[str, str]]]:
    """Order of bytes (empty: text), number of vertices, and their properties with their types."""
    words = [line.split() for line in header if line and not line.startswith(("comment", "obj_info"))]
    formats = [word[1] for word in words if word[0] == "format" and len(word) > 1]
    elements = [number for number, word in enumerate(words) if word[0] == "element"]
    if not formats or formats[0] not in ORDERS or not elements or words[elements[0]][1:2] != ["vertex"]:
        raise UserError(f"{path}: not a PLY point cloud; accepted: vertices first, as text or binary")
    first, following = elements[0], elements[1] if len(elements) > 1 else len(words)
    count = words[first][2] if len(words[first]) > 2 else ""
    properties = []
    for word in words[first + 1 : following]:
        if len(word) != 3 or word[0] != "property" or word[1] not in TYPES:
            raise UserError(f"{path}: '{' '.join(word)[:60]}' is not accepted; accepted: properties of numbers")
        properties.append((word[2], TYPES[word[1]]))
    names = [name for name, _ in properties]
    if not count.isdigit() or len(count) > 12 or len(set(names)) < len(names) or not names:
        raise UserError(f"{path}: its header is damaged; accepted: a PLY point cloud")
    return ORDERS[formats[0]], int(count), properties


def _table(path: Path, body: bytes, order: str, count: int, properties: list[tuple[str, str]]) -> dict[str, np.ndarray]:
    short = UserError(f"{path}: holds less than {count} vertices")
    if order:
        kind = np.dtype([(name, order + letters) for name, letters in properties])
        if len(body) < count * kind.itemsize:
            raise short
        rows = np.frombuffer(body, kind, count)
        return {name: rows[name].astype(rows[name].dtype.newbyteorder("=")) for name, _ in properties}
    lines = [line.split() for line in body.splitlines()[:count]]
    if len(lines) < count or any(len(line) < len(properties) for line in lines):
        raise short
    try:
        numbers = np.array([line[: len(properties)] for line in lines], dtype=np.float64)
    except ValueError:
        raise UserError(f"{path}: holds something that is not a number") from None
    numbers = numbers.reshape(count, len(properties))
    return {name: numbers[:, k].astype(letters) for k, (name, letters) in enumerate(properties)}
