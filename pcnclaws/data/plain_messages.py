"""Plain values as bytes and back, for what another process sends: reading a message runs no code from it.

The first part is JSON: {"map": [[key, value], ...]} is a mapping, {"array": [type, shape]} the next one of the other
parts, raw numbers.
"""

import json
import math
import re
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

# Types of arrays, in the byte order of this machine or of one byte.
TYPE = re.compile(r"[<>=|][fiub](1|2|4|8|16)")


class NotAMessage(ValueError):
    """Bytes that are no message."""


def to_message(value: object) -> list[memoryview]:
    """The parts of a message.

    value  of None, booleans, numbers, texts, arrays of numbers, and lists and mappings of such values
    """
    arrays: list[memoryview] = []
    head = json.dumps(_packed(value, arrays)).encode("ascii")
    return [memoryview(head), *arrays]


def from_message(parts: Sequence[bytearray]) -> Any:
    """The value of a message; its arrays are those of the parts, without a copy.

    raises  NotAMessage
    """
    if not parts:
        raise NotAMessage("no part")
    arrays = iter(parts[1:])
    try:
        value = _unpacked(json.loads(parts[0]), arrays)
    except (ValueError, TypeError, OverflowError, RecursionError, StopIteration) as fault:
        raise NotAMessage(type(fault).__name__) from fault
    if next(arrays, None) is not None:
        raise NotAMessage("a part too many")
    return value


def _packed(value: object, arrays: list[memoryview]) -> object:
    if isinstance(value, np.ndarray):
        if value.dtype.kind not in "fiub":
            raise TypeError(f"arrays of {value.dtype} are no plain values")
        whole = np.ascontiguousarray(value)
        arrays.append(whole.reshape(-1).view(np.uint8).data)
        return {"array": [value.dtype.str, list(value.shape)]}
    if isinstance(value, dict):
        return {"map": [[key, _packed(one, arrays)] for key, one in value.items()]}
    if isinstance(value, (list, tuple)):
        return [_packed(one, arrays) for one in value]
    return value


def _unpacked(value: Any, arrays: Iterator[bytearray]) -> Any:
    if isinstance(value, list):
        return [_unpacked(one, arrays) for one in value]
    if not isinstance(value, dict):
        return value
    ((kind, content),) = value.items()
    if kind == "map":
        return {_text(key): _unpacked(one, arrays) for key, one in content}
    if kind == "array":
        of, shape = content
        return _array(of, shape, next(arrays))
    raise NotAMessage(f"an unknown {kind[:20]!a}")


def _array(of: Any, shape: Any, content: bytearray) -> np.ndarray:
    if not TYPE.fullmatch(_text(of)):
        raise NotAMessage("an array of no numbers")
    kind = np.dtype(of)
    if not all(type(length) is int and length >= 0 for length in shape):
        raise NotAMessage("no shape")
    if math.prod(shape) * kind.itemsize != len(content):
        raise NotAMessage("an array of another size")
    return np.frombuffer(content, kind).reshape(shape) if content else np.empty(shape, kind)


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise NotAMessage("no text")
    return value
