"""Access to an HDF5 file that is not trusted: every object, shape and number is checked before it is used."""

import math
import mmap
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from pcnclaws.data.room import require_room
from pcnclaws.errors import UserError

# gzip, shuffle, fletcher32, szip, n-bit, scale-offset and lzf are part of h5py; any other filter loads a plugin.
FILTERS = frozenset({1, 2, 3, 4, 5, 6, 32000})
MAXIMUM_BYTES = 16 * 1024**3
# gzip shrinks 1032 times at most: an array that claims more than this was never written.
MAXIMUM_COMPRESSION = 1100
# Particles, frames, or nodes along an axis.
MAXIMUM_LENGTH = 10**8
FREE_BYTES = 64 * 1024**2
MAXIMUM_ATTRIBUTE_BYTES = 4096
# Where HDF5 keeps texts: global heap collections, version 1 (HDF5 file format specification, III.E).
HEAP_SIGNATURE = b"GCOL\x01\x00\x00\x00"
HEAP_HEADER = 16
# Attributes of datasets by which HDF5 keeps house: nobody's data.
HOUSEKEEPING = frozenset({"CLASS", "NAME", "DIMENSION_LIST", "DIMENSION_LABELS", "REFERENCE_LIST", "_FillValue"})


@contextmanager
def one_line_faults(where: str) -> Iterator[None]:
    """Turns whatever HDF5 raises on a damaged file into a UserError of one line; all of them begin with `where`."""
    try:
        yield
    except UserError as error:
        if str(error).startswith(where):
            raise
        raise UserError(f"{where}: {error}") from error
    except (
        OSError,
        RuntimeError,
        LookupError,
        ValueError,
        TypeError,
        AttributeError,
        ArithmeticError,
        NotImplementedError,
        MemoryError,
    ) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise UserError(f"{where}: damaged or unreadable ({reason[:200]})") from error


def check_heaps(path: Path) -> None:
    """Refuses a file whose texts are damaged with a UserError: the HDF5 library never returns from reading some."""
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        start = content.find(HEAP_SIGNATURE)
        while start >= 0:
            end = start + int.from_bytes(content[start + 8 : start + HEAP_HEADER], "little")
            if end > len(content) or not _is_heap_intact(content, start + HEAP_HEADER, end):
                raise UserError(f"{path}: damaged or unreadable (its texts are broken)")
            start = content.find(HEAP_SIGNATURE, start + 1)


def _is_heap_intact(content: mmap.mmap, place: int, end: int) -> bool:
    """Whether the objects of a heap, each a header and a size rounded up to 8 bytes, fill it; number 0 is the rest."""
    while end - place >= HEAP_HEADER:
        size = int.from_bytes(content[place + 8 : place + HEAP_HEADER], "little")
        if content[place : place + 2] == b"\x00\x00":
            return size == end - place
        place += HEAP_HEADER + -(-size // 8) * 8
    return place <= end


class GuardedGroup:
    """A group of a file whose links, datasets and attributes are checked before they are read.

    where  the group in error messages
    """

    def __init__(self, group: h5py.Group, where: str) -> None:
        self._group, self.where = group, where
        self._asked: set[str] = set()
        self._below: dict[str, GuardedGroup] = {}
        self._of_arrays: set[str] = set()

    def fault(self, text: str) -> UserError:
        """The error of one line for something wrong in this group."""
        return UserError(f"{self.where}: {text}")

    def names(self) -> list[str]:
        """Names of the members, sorted."""
        self._asked.update(self._group)
        return sorted(self._group)

    def unread(self) -> list[str]:
        """Attributes '@name' and members that nobody asked for, sorted, and those of the groups below by their path."""
        own = {f"@{name}" for name in self._group.attrs} | set(self._group)
        below = {f"{name}/{left}" for name, group in self._below.items() for left in group.unread()}
        return sorted((own - self._asked) | self._of_arrays | below)

    def __contains__(self, name: str) -> bool:
        self._asked.add(name)
        return self._group.get(name, getlink=True) is not None

    def group(self, name: str, where: str | None = None) -> "GuardedGroup":
        """The member group of that name."""
        member = self._member(name)
        if not isinstance(member, h5py.Group):
            raise self.fault(f"'{name}' is not a group")
        self._below[name] = GuardedGroup(member, where or self.where)
        return self._below[name]

    def array(self, name: str, shape: Sequence[int | None], kinds: str = "f") -> np.ndarray:
        """The dataset of that name in the machine's byte order.

        shape  expected length of each dimension, None for any
        kinds  accepted kinds of NumPy types
        """
        data = self._member(name)
        if not isinstance(data, h5py.Dataset):
            raise self.fault(f"'{name}' is not a dataset")
        expected = ", ".join("any" if length is None else str(length) for length in shape)
        if (
            data.shape is None
            or len(data.shape) != len(shape)
            or any(want is not None and want != have for want, have in zip(shape, data.shape, strict=True))
        ):
            raise self.fault(f"'{name}' has the shape {data.shape}; accepted: ({expected})")
        if 0 in data.shape:
            raise self.fault(f"'{name}' is empty")
        if data.dtype.kind not in kinds:
            accepted = "whole numbers" if "i" in kinds else "floating-point numbers"
            raise self.fault(f"'{name}' holds {data.dtype}; accepted: {accepted}")
        self._check_storage(name, data)
        self._of_arrays |= {f"{name}/@{attribute}" for attribute in data.attrs if attribute not in HOUSEKEEPING}
        values = np.asarray(data[()])
        return values.astype(values.dtype.newbyteorder("="), copy=False)

    def number(self, name: str) -> float:
        """The attribute of that name as a finite number."""
        value = np.asarray(self._attribute(name))
        if value.size != 1 or value.dtype.kind not in "fiu" or not math.isfinite(number := float(value.reshape(()))):
            raise self.fault(f"@{name} is not a finite number")
        return number

    def whole_number(self, name: str) -> int:
        """The attribute of that name as a whole number."""
        number = self.number(name)
        if not number.is_integer():
            raise self.fault(f"@{name}={number:g} is not a whole number")
        return int(number)

    def vector(self, name: str) -> tuple[float, float, float]:
        """The attribute of that name as three finite numbers."""
        value = np.asarray(self._attribute(name))
        if value.shape != (3,) or value.dtype.kind not in "fiu" or not np.isfinite(value).all():
            raise self.fault(f"@{name} is not three finite numbers")
        x, y, z = (float(component) for component in value)
        return x, y, z

    def numbers(self, name: str, shape: tuple[int, ...]) -> np.ndarray:
        """The attribute of that name as finite numbers of a shape."""
        value = np.asarray(self._attribute(name))
        if value.shape != shape or value.dtype.kind not in "fiu" or not np.isfinite(value).all():
            raise self.fault(f"@{name} is not {' x '.join(map(str, shape))} finite numbers")
        return value.astype(np.float64)

    def options(self) -> dict[str, Any]:
        """All attributes: texts of one line, finite numbers, and three of them."""
        found: dict[str, Any] = {}
        for name in sorted(self._group.attrs):
            value = np.asarray(self._attribute(name))
            if value.dtype.kind not in "fiu":
                found[name] = self.text(name)
            else:
                found[name] = self.number(name) if value.size == 1 else list(self.vector(name))
        return found

    def text(self, name: str) -> str:
        """The attribute of that name as one printable line."""
        value = self._attribute(name)
        if isinstance(value, np.ndarray) and value.size == 1:
            value = value.reshape(-1)[0]
        if isinstance(value, bytes):
            value = value.decode("utf-8", errors="replace")
        if not isinstance(value, str) or not value.isprintable() or not 0 < len(value) <= 100:
            raise self.fault(f"@{name} is not a text of one line")
        return str(value)

    def has_attribute(self, name: str) -> bool:
        """Whether the group has the attribute of that name."""
        self._asked.add(f"@{name}")
        return name in self._group.attrs

    def _member(self, name: str) -> h5py.Group | h5py.Dataset | h5py.Datatype:
        self._asked.add(name)
        link = self._group.get(name, getlink=True)
        if link is None:
            raise self.fault(f"'{name}' is missing")
        if not isinstance(link, h5py.HardLink):
            raise self.fault(f"'{name}' is a link to somewhere else; accepted: data in the file itself")
        return self._group[name]

    def _attribute(self, name: str) -> object:
        if not self.has_attribute(name):
            raise self.fault(f"@{name} is missing")
        identity = self._group.attrs.get_id(name)
        if identity.get_storage_size() > MAXIMUM_ATTRIBUTE_BYTES:
            raise self.fault(f"@{name} is too long")
        return self._group.attrs[name]

    def _check_storage(self, name: str, data: h5py.Dataset) -> None:
        if data.external or data.is_virtual:
            raise self.fault(f"'{name}' is stored in another file; accepted: data in the file itself")
        properties = data.id.get_create_plist()
        filters = {properties.get_filter(i)[0] for i in range(properties.get_nfilters())}
        if not filters <= FILTERS:
            raise self.fault(f"'{name}' needs an HDF5 plugin; accepted compression: gzip, lzf, szip or none")
        if max(data.shape) > MAXIMUM_LENGTH:
            raise self.fault(f"'{name}' has the shape {data.shape}; accepted: at most {MAXIMUM_LENGTH:.0e} of a kind")
        size = math.prod(data.shape) * data.dtype.itemsize
        if size > min(MAXIMUM_BYTES, FREE_BYTES + MAXIMUM_COMPRESSION * data.id.get_storage_size()):
            raise self.fault(f"'{name}' claims {size / 1024**3:.3g} GiB that the file does not hold or nobody can read")
        require_room(size, f"{self.where}: '{name}'")
