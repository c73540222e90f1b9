"""Arrays of numbers in a pickle, read without running code from it and without NumPy's own way of unpickling.

A pickle says which functions are called with what. Here a name stands for one of four classes of ours, which keep what
they are given, or the file is refused; arrays are made of the kept shape, type and bytes at the end.
"""

import math
import pickle
from typing import Any, ClassVar
from zipfile import ZipExtFile

import numpy as np

# Types of numbers, as pickles name them.
KINDS = ("f2", "f4", "f8", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "b1")
OBJECTS = "O8"
DEEPEST = 4


class _Type:
    """What stands for numpy.dtype."""

    def __init__(self, code: str = "", *_: object) -> None:
        self.code, self.order = code, "<"

    def __setstate__(self, state: Any) -> None:
        self.order = state[1]


class _Kept:
    """What stands for an array: the state that it would be given."""

    state: Any = None

    def __init__(self, *_: object) -> None:
        pass

    def __setstate__(self, state: Any) -> None:
        self.state = state


class _ArrayClass:
    """What stands for numpy.ndarray, which is passed on and never made."""


def _bytes_of(text: str, encoding: str) -> bytes:
    """What stands for the function by which old pickles hold bytes."""
    if encoding != "latin1":
        raise ValueError(f"bytes as {encoding[:20]!a}")
    return text.encode("latin1")


def _number(kind: _Type, content: bytes) -> _Kept:
    """What stands for the function that makes a number of NumPy's."""
    kept = _Kept()
    kept.state = (1, (), kind, False, content)
    return kept


# What a pickle may do: keep texts, bytes, numbers, tuples and lists, name a class, call it, give it its state.
CODES = (
    *(pickle.PROTO, pickle.FRAME, pickle.STOP, pickle.MARK, pickle.NONE, pickle.NEWTRUE, pickle.NEWFALSE),
    *(pickle.BININT, pickle.BININT1, pickle.BININT2, pickle.LONG1, pickle.BINFLOAT),
    *(pickle.BINUNICODE, pickle.SHORT_BINUNICODE, pickle.BINBYTES, pickle.SHORT_BINBYTES, pickle.BINBYTES8),
    *(pickle.EMPTY_TUPLE, pickle.TUPLE, pickle.TUPLE1, pickle.TUPLE2, pickle.TUPLE3),
    *(pickle.EMPTY_LIST, pickle.APPEND, pickle.APPENDS),
    *(pickle.MEMOIZE, pickle.BINPUT, pickle.LONG_BINPUT, pickle.BINGET, pickle.LONG_BINGET),
    *(pickle.GLOBAL, pickle.STACK_GLOBAL, pickle.REDUCE, pickle.BUILD),
)
KNOWN = {
    ("numpy", "dtype"): _Type,
    ("numpy", "ndarray"): _ArrayClass,
    ("numpy.core.multiarray", "_reconstruct"): _Kept,
    ("numpy._core.multiarray", "_reconstruct"): _Kept,
    ("numpy.core.multiarray", "scalar"): _number,
    ("numpy._core.multiarray", "scalar"): _number,
    ("_codecs", "encode"): _bytes_of,
}


class _Reader(pickle._Unpickler):
    """The reader in Python: that in C makes room for whatever a damaged file claims to remember."""

    dispatch: ClassVar[dict[int, Any]] = {code[0]: pickle._Unpickler.dispatch[code[0]] for code in CODES}

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) not in KNOWN:
            raise ValueError(f"it names {module[:60]!a}.{name[:60]!a}, which is no array")
        return KNOWN[module, name]


def pickled_arrays(file: ZipExtFile) -> Any:
    """Arrays of numbers, and lists and numbers as they are nested in the pickle; arrays of objects become lists.

    raises  ValueError, or whatever a damaged pickle makes Python raise
    """
    return _plain(_Reader(file).load(), DEEPEST, {})


def _plain(value: Any, depth: int, known: dict[int, Any]) -> Any:
    """known: what became of values that have been met before; a pickle may name one a million times."""
    if depth < 0:
        raise ValueError("its lists are nested too deep")
    if isinstance(value, bool | int | float):
        return value
    if id(value) not in known:
        if isinstance(value, list | tuple):
            known[id(value)] = [_plain(one, depth - 1, known) for one in value]
        elif isinstance(value, _Kept):
            known[id(value)] = _array(value.state, depth, known)
        else:
            raise ValueError(f"it holds {type(value).__name__}, which is no number")
    return known[id(value)]


def _array(state: Any, depth: int, known: dict[int, Any]) -> Any:
    _, shape, kind, by_columns, content = state
    if kind.code == OBJECTS:
        return _plain(content, depth, known)
    if kind.code not in KINDS or not isinstance(content, bytes):
        raise ValueError(f"an array of {str(kind.code)[:20]!a}; accepted: numbers")
    shape = tuple(int(one) for one in shape)
    if min(shape, default=0) < 0:
        raise ValueError(f"an array of the shape {shape}")
    dtype = np.dtype((">" if kind.order == ">" else "<") + kind.code)
    if math.prod(shape) * dtype.itemsize != len(content):
        raise ValueError(f"an array of the shape {shape} in {len(content)} bytes")
    values = np.frombuffer(content, dtype).reshape(shape, order="F" if by_columns else "C")
    return values.astype(dtype.newbyteorder("="))
