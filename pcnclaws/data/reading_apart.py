"""HDF5 files of others are read in a forked child.

There are damaged files on which the HDF5 library crashes, at once or later, or from which it never returns.
"""

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from pcnclaws.data.forked import ChildFailed, in_child
from pcnclaws.errors import UserError

Result = TypeVar("Result")

# A child may take so long to read a file [s], and so much longer for its size [bytes/s].
PATIENCE, SLOWEST = 8.0, 10e6


def read_apart(path: Path, read: Callable[[], Result]) -> Result:
    """What `read` finds in a file, plain values as plain_messages has them.

    raises  UserError of one line where the library fails on the file
    """
    try:
        return in_child(read, PATIENCE + path.stat().st_size / SLOWEST)
    except ChildFailed as fate:
        raise UserError(f"{path}: damaged or unreadable (the HDF5 library fails on it: {fate})") from fate
