"""Files of others that native code reads, such as HDF5, are read in a forked child.

There are damaged files on which a library crashes, at once or later, or from which it never returns.
"""

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from pcnclaws.data.forked import ChildFailed, in_child
from pcnclaws.errors import UserError

Result = TypeVar("Result")

# A child may take so long to read a file [s], and so much longer for its size [bytes/s].
PATIENCE, SLOWEST = 8.0, 10e6


def read_apart(
    path: Path, read: Callable[[], Result], library: str = "the HDF5 library", slowest: float = SLOWEST
) -> Result:
    """What `read` finds in a file, plain values as plain_messages has them.

    library  that reads it, for the message
    slowest  rate at which it may do so [bytes/s]
    raises   UserError of one line where the library fails on the file
    """
    try:
        return in_child(read, PATIENCE + path.stat().st_size / slowest)
    except ChildFailed as fate:
        raise UserError(f"{path}: damaged or unreadable ({library} fails on it: {fate})") from fate
