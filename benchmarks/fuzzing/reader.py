"""A reader under test."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple


class Reader(NamedTuple):
    """A reader under test.

    ending  of its files
    read    reads one; raises UserError to refuse it
    """

    ending: str
    read: Callable[[Path], object]
