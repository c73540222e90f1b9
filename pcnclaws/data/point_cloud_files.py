"""Frames of a motion for other programs: PLY point clouds, and VTK XML with a collection of them for ParaView.

Both formats hold little-endian arrays of the precision of the motion; the VTK ones as base64 text.
"""

import base64
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from pcnclaws.atomic import replaced_file

PLY_TYPES = {np.dtype("float32"): "float", np.dtype("float64"): "double", np.dtype("int32"): "int"}
VTK_TYPES = {"f4": "Float32", "f8": "Float64", "i4": "Int32", "i8": "Int64", "u1": "UInt8"}
VTK_VERTEX = 1

Fields = Mapping[str, np.ndarray]


def write_ply(path: Path, position: np.ndarray, fields: Fields, comment: str) -> None:
    """Writes a PLY point cloud, binary.

    position  [m], (particles, 3): the properties x, y, z
    fields    further properties by name, each (particles, ...); components of tensors are numbered, velocity_0, ...
    comment   one line of the header
    """
    properties = dict(zip("xyz", position.T, strict=True)) | columns(fields, len(position))
    table = np.empty(len(position), [(name, values.dtype.newbyteorder("<")) for name, values in properties.items()])
    for name, values in properties.items():
        table[name] = values
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment {comment}",
        f"element vertex {len(position)}",
        *(f"property {PLY_TYPES[values.dtype]} {name}" for name, values in properties.items()),
        "end_header",
        "",
    ]
    with replaced_file(path) as part:
        part.write("\n".join(header).encode("ascii") + table.tobytes())


def columns(fields: Fields, count: int) -> dict[str, np.ndarray]:
    """Fields of particles as columns, each (particles,); components are numbered by rows, velocity_0, ..."""
    found: dict[str, np.ndarray] = {}
    for name, values in fields.items():
        flat = values.reshape(count, math.prod(values.shape[1:]))
        found |= {name if flat.shape[1] == 1 else f"{name}_{k}": flat[:, k] for k in range(flat.shape[1])}
    return found


def write_vtu(path: Path, position: np.ndarray, fields: Fields, comment: str) -> None:
    """Writes a VTK unstructured grid whose cells are single points.

    position  [m], (particles, 3)
    fields    point data by name, each (particles, ...)
    comment   one line ahead of the grid
    """
    count = len(position)
    cells = {
        "connectivity": np.arange(count),
        "offsets": np.arange(1, count + 1),
        "types": np.full(count, VTK_VERTEX, np.uint8),
    }
    lines = [
        f"<!-- {comment.replace('--', '- -')} -->",
        '<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" header_type="UInt64">',
        f'<UnstructuredGrid><Piece NumberOfPoints="{count}" NumberOfCells="{count}">',
        f"<Points>{_vtk_array('position', position)}</Points>",
        f"<Cells>{''.join(_vtk_array(name, values) for name, values in cells.items())}</Cells>",
        f"<PointData>{''.join(_vtk_array(name, values) for name, values in fields.items())}</PointData>",
        "</Piece></UnstructuredGrid></VTKFile>",
    ]
    _write_xml(path, lines)


def write_pvd(path: Path, times: Sequence[float], files: Sequence[str]) -> None:
    """Writes a ParaView collection: the files, named from its folder, and their times [s]."""
    frames = [
        f'<DataSet timestep="{time:.17g}" file={quoteattr(file)}/>' for time, file in zip(times, files, strict=True)
    ]
    _write_xml(path, ['<VTKFile type="Collection" version="1.0"><Collection>', *frames, "</Collection></VTKFile>"])


def _vtk_array(name: str, values: np.ndarray) -> str:
    flat = values.reshape(len(values), math.prod(values.shape[1:]))
    flat = np.ascontiguousarray(flat, flat.dtype.newbyteorder("<"))
    content = base64.b64encode(np.uint64(flat.nbytes).astype("<u8").tobytes() + flat.tobytes()).decode("ascii")
    kind = VTK_TYPES[flat.dtype.str[1:]]
    return (
        f'<DataArray type="{kind}" Name="{name}" NumberOfComponents="{flat.shape[1]}" format="binary">'
        f"{content}</DataArray>"
    )


def _write_xml(path: Path, lines: Sequence[str]) -> None:
    with replaced_file(path) as part:
        part.write("\n".join(['<?xml version="1.0"?>', *lines, ""]).encode("utf-8"))
