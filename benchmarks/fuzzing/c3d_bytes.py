"""C3D files byte by byte, without a library: both forms of storage, the parameters of points, and nothing else.

source  The C3D File Format User Guide, Motion Lab Systems
"""

import struct
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int

BLOCK = 512
KEY, INTEL = 0x50, 84
# Of a point that was seen: cameras in the upper byte but its sign, the size of the residual in the lower one.
CAMERAS_AND_RESIDUAL = 0x05F2


def c3d_bytes(
    points: Int[np.ndarray, "frames points 3"] | Float[np.ndarray, "frames points 3"],
    seen: np.ndarray,
    labels: Sequence[str],
    scale: float,
    rate: float,
    first_frame: int = 1,
    more: Mapping[str, object] | None = None,
) -> bytes:
    """A file of Intel byte order.

    points       as they are stored: 16-bit integers where scale > 0, single precision where it is negative
    seen         (frames, points); the others have the residual -1
    scale        length of a unit, or any negative number
    rate         frames a second
    first_frame  its number; the first of a recording has 1
    more         parameters of the group POINT that are added, such as {"UNITS": "mm"}, or None to leave one out
    """
    frames, count = points.shape[:2]
    group: dict[str, object] = {
        "USED": np.array(count, "<i2"),
        "SCALE": np.array(scale, "<f4"),
        "RATE": np.array(rate, "<f4"),
        "DATA_START": np.array(0, "<i2"),
        "FRAMES": np.array(frames, "<i2"),
        "LABELS": [*labels[:255]],
        **({"LABELS2": [*labels[255:]]} if len(labels) > 255 else {}),
        **(more or {}),
    }
    kept = {name: value for name, value in group.items() if value is not None}
    start = 2 + len(_parameters(kept)) // BLOCK
    if "DATA_START" in kept:
        kept["DATA_START"] = np.array(start, "<i2")
    word = "<f4" if scale < 0 else "<i2"
    data = np.zeros((frames, count, 4), word)
    data[:, :, :3] = points
    data[:, :, 3] = np.where(seen, CAMERAS_AND_RESIDUAL, -1)
    header = struct.pack(
        "<BBHHHHHfHHf", 2, KEY, count, 0, first_frame, first_frame + frames - 1, 10, scale, start, 0, rate
    )
    return header.ljust(BLOCK, b"\0") + _parameters(kept) + _padded(data.tobytes())


def _parameters(group: Mapping[str, object]) -> bytes:
    """The parameter section with the one group POINT."""
    records = _record("POINT", -1, b"")
    for name, value in group.items():
        records += _record(name, 1, _value(value))
    records += b"\0\0"
    blocks = -(-(len(records) + 4) // BLOCK)
    return _padded(bytes((1, KEY, blocks, INTEL)) + records)


def _record(name: str, number: int, value: bytes) -> bytes:
    """A group, of a negative number, or a parameter: name, distance of the next one, value, and no description."""
    body = value + b"\0"
    return struct.pack("<bb", len(name), number) + name.encode("ascii") + struct.pack("<h", len(body) + 2) + body


def _value(value: object) -> bytes:
    """Type, dimensions and content of a parameter."""
    if isinstance(value, str):
        return struct.pack("<bBB", -1, 1, len(value)) + value.encode("latin-1")
    if isinstance(value, list):
        longest = max(map(len, value), default=0)
        text = "".join(one.ljust(longest) for one in value).encode("latin-1")
        return struct.pack("<bBBB", -1, 2, longest, len(value)) + text
    numbers = np.asarray(value)
    kind = {1: 1, 2: 2, 4: 4}[numbers.dtype.itemsize]
    return struct.pack(f"<bB{numbers.ndim}B", kind, numbers.ndim, *numbers.shape) + numbers.tobytes()


def _padded(content: bytes) -> bytes:
    return content.ljust(-(-len(content) // BLOCK) * BLOCK, b"\0")
