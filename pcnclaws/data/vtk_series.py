"""Trajectories from a ParaView collection of VTK XML files."""

import base64
import binascii
import re
import xml.etree.ElementTree as ElementTree
import zlib
from pathlib import Path

import numpy as np

from pcnclaws.data.frame_records import READ, Frame, checked_fields, name_unread, record_of
from pcnclaws.data.room import require_room
from pcnclaws.data.scene_notes import notes_in_line
from pcnclaws.errors import UserError
from pcnclaws.simulation.records import SceneRecord

TYPES = {
    "Float32": "f4",
    "Float64": "f8",
    "Int8": "i1",
    "UInt8": "u1",
    "Int16": "i2",
    "UInt16": "u2",
    "Int32": "i4",
    "UInt32": "u4",
    "Int64": "i8",
    "UInt64": "u8",
}
ZLIB = "vtkZLibDataCompressor"
COMMENT = re.compile(r"<!--\s*(.*?)\s*-->", re.DOTALL)


def read_vtk_series(path: Path, material: str) -> SceneRecord:
    """The scene of a .pvd file: the .vtu or .vtp files that it names, in its folder, with their times [s].

    The points of each have the data volume [m^3] and, optionally, velocity, density, id and physical parameters. Arrays
    are text or base64, with or without zlib.
    raises  UserError, one line, for whatever is wrong with a file
    """
    named = []
    for entry in _parsed(path)[0].iter("DataSet"):
        try:
            named.append((float(entry.attrib["timestep"]), entry.attrib["file"]))
        except (KeyError, ValueError):
            raise UserError(f"{path}: has a DataSet without timestep or file") from None
    if not named:
        raise UserError(f"{path}: names no file; accepted: a collection of .vtu files")
    unread: list[str] = []
    frames, taken = [], 0
    for time, name in sorted(named):
        file = path.parent / name
        if file.parent.resolve() != path.parent.resolve() and path.parent.resolve() not in file.resolve().parents:
            raise UserError(f"{path}: names the file {name[:100]!a}; accepted: files in its folder")
        frames.append(_frame(file, time, unread))
        taken += sum(values.nbytes for values in (frames[-1].position, *frames[-1].fields.values()))
        require_room(taken, str(path))  # small files unpack to large ones, and a file may be named many times
    name_unread(path, unread)
    return record_of(frames, path, path.stem, material)


def _parsed(path: Path) -> tuple[ElementTree.Element, dict]:
    """The root of an XML file, and the notes of its comments."""
    if not path.is_file():
        raise UserError(f"{path}: no such file")
    require_room(2 * path.stat().st_size, str(path))
    text = path.read_bytes()
    if b"<!DOCTYPE" in text or b"<!ENTITY" in text:
        raise UserError(f"{path}: declares a document type; accepted: VTK XML without")
    try:
        root = ElementTree.fromstring(text)  # noqa: S314  # entities are refused above
    except (ElementTree.ParseError, ValueError) as error:
        raise UserError(f"{path}: not a VTK XML file, or damaged ({str(error)[:100]})") from error
    if root.tag != "VTKFile":
        raise UserError(f"{path}: not a VTK XML file; accepted: .pvd and .vtu")
    notes: dict = {}
    for comment in COMMENT.findall(text[:40_000].decode("utf-8", errors="replace")):
        notes |= notes_in_line(comment, str(path))
    return root, notes


def _frame(path: Path, time: float, unread: list[str]) -> Frame:
    root, notes = _parsed(path)
    pieces = list(root.iter("Piece"))
    points = pieces[0].find("Points/DataArray") if len(pieces) == 1 else None
    if points is None:
        raise UserError(f"{path}: has {len(pieces)} pieces; accepted: one, with points")
    reader = _Arrays(path, root)
    position = reader.read(points)
    if position.ndim != 2 or position.shape[1] != 3:
        raise UserError(f"{path}: its points have the shape {position.shape}; accepted: (particles, 3)")
    fields = {}
    for array in pieces[0].iterfind("PointData/DataArray"):
        name = array.attrib.get("Name", "")
        if name in READ:
            fields[name] = reader.read(array)
        else:
            unread.append(name)
    position = position.astype(np.float64 if position.dtype.itemsize == 8 else np.float32)
    return Frame(time, position, checked_fields(fields, len(position), str(path)), notes)


class _Arrays:
    """Reader of the arrays of a file."""

    def __init__(self, path: Path, root: ElementTree.Element) -> None:
        self._path = path
        self._order = ">" if root.attrib.get("byte_order") == "BigEndian" else "<"
        self._header = np.dtype(self._order + ("u8" if root.attrib.get("header_type") == "UInt64" else "u4"))
        self._compressor = root.attrib.get("compressor", "")
        if self._compressor not in ("", ZLIB):
            raise UserError(f"{path}: is compressed by {self._compressor[:40]}; accepted: {ZLIB}, or none")

    def read(self, array: ElementTree.Element) -> np.ndarray:
        """The values, (tuples, components) or (tuples,)."""
        name, kind = array.attrib.get("Name", "")[:60], TYPES.get(array.attrib.get("type", ""))
        way, text = array.attrib.get("format", "ascii"), array.text or ""
        components = array.attrib.get("NumberOfComponents", "1")
        if kind is None or way not in ("ascii", "binary") or not components.isdigit() or not int(components):
            raise UserError(
                f"{self._path}: the array {name!a} of {array.attrib.get('type', '')[:20]} is {way[:20]}; accepted: "
                "numbers as ascii or binary (in ParaView: Data Mode), not appended"
            )
        try:
            if way == "ascii":
                values = np.array(text.split(), dtype=kind)
            else:
                values = np.frombuffer(self._decoded(text.strip()), self._order + kind).astype(kind)
            return values.reshape(-1, int(components)) if int(components) > 1 else values
        except (ValueError, OverflowError, binascii.Error, zlib.error, IndexError) as error:
            raise UserError(f"{self._path}: the array {name!a} is damaged ({str(error)[:100]})") from error

    def _decoded(self, text: str) -> bytes:
        size = self._header.itemsize
        if not self._compressor:
            content = base64.b64decode(text)
            (length,) = np.frombuffer(content[:size], self._header).tolist()
            if length != len(content) - size:
                raise ValueError(f"{len(content) - size} bytes instead of {length}")
            return content[size:]
        count = int(np.frombuffer(base64.b64decode(text[: 4 * -(-size // 3)])[:size], self._header)[0])
        if count * size > len(text):
            raise ValueError(f"{count} blocks in {len(text)} bytes")
        letters = 4 * -(-(3 + count) * size // 3)
        header = np.frombuffer(base64.b64decode(text[:letters])[: (3 + count) * size], self._header).tolist()
        blocks, found, begin = base64.b64decode(text[letters:]), [], 0
        _, largest, last, *sizes = header
        require_room(count * largest, str(self._path))
        for number, length in enumerate(sizes):
            whole = last if number == count - 1 and last else largest
            found.append(zlib.decompressobj().decompress(blocks[begin : begin + length], whole or 1))
            begin += length
        return b"".join(found)
