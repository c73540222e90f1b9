"""What the commands of pages share."""

import sys
from collections.abc import Callable, Iterable
from pathlib import Path

from pcnclaws.errors import UserError


def write_and_say(write: Callable[[], Iterable[Path]]) -> None:
    """Writes a page and names its files; wrong input is one line and exit status 2."""
    try:
        for path in write():
            print(f"wrote {path}")
    except UserError as fault:
        print(fault, file=sys.stderr)
        sys.exit(2)
