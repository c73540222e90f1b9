"""Tables of comma-separated values, opened."""

import csv
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from pcnclaws.errors import UserError


@contextmanager
def opened_table(path: Path) -> Iterator[TextIO]:
    """The text of a table for the readers of csv, whose complaints become one line.

    raises  UserError for a file that is not there, and for a cell longer than any number or name
    """
    if not path.is_file():
        raise UserError(f"{path}: no such file")
    try:
        with path.open(newline="", encoding="utf-8-sig", errors="replace") as text:
            yield text
    except csv.Error as error:
        raise UserError(f"{path}: no table of comma-separated values, or damaged ({error})") from error
