"""Files that appear whole or not at all.

Whoever writes a file writes it to memory, and only bytes go to the disk: libraries that meet a full disk in the middle
of their own format leave tracebacks, partial files, or crash when the process ends.
"""

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path

from pcnclaws.errors import CannotWrite, UserError, is_full, reason

PARTIAL_SUFFIX = ".partial"


@contextmanager
def replaced_file(path: str | Path, previous: Path | None = None) -> Iterator[BytesIO]:
    """A file in memory that takes the place of the one at `path` when the block ends well.

    Folders above it are made. A killed process leaves at most a hidden file that ends in PARTIAL_SUFFIX.
    previous  where the file goes that was at `path`, None where nobody needs it
    raises    UserError when no file can be written there, CannotWrite when there is no room for this one
    """
    given, path = path, Path(os.path.realpath(path))  # a link stays a link: its target is replaced
    with one_line_writing(given):
        if path.is_dir():
            raise IsADirectoryError(None, "is a folder", str(path))
        if path.exists() and not path.is_file():
            raise OSError(None, "is not a regular file", str(path))
        path.parent.mkdir(parents=True, exist_ok=True)
    content = BytesIO()
    yield content
    with one_line_writing(given):
        _replace(path, content, previous)


@contextmanager
def one_line_writing(path: str | Path) -> Iterator[None]:
    """Turns what the operating system says of a file that cannot be written into one line of ours.

    raises  CannotWrite where there is no room, UserError where the path is wrong
    """
    try:
        yield
    except OSError as error:
        if is_full(error):
            raise CannotWrite(f"{path} cannot be written ({reason(error)})") from error
        raise UserError(f"{path}: cannot be written ({reason(error)}); accepted: the path of a file") from error


def remove_partial_files(folder: Path) -> None:
    """Removes what killed processes left in a folder; only safe while nobody else writes there."""
    for leftover in folder.glob(f".*{PARTIAL_SUFFIX}"):
        leftover.unlink(missing_ok=True)


def _replace(path: Path, content: BytesIO, previous: Path | None) -> None:
    temporary = path.with_name(f".{path.name[:100]}.{secrets.token_hex(4)}{PARTIAL_SUFFIX}")
    try:
        with temporary.open("xb", buffering=0) as file:
            _write_all(file.fileno(), content)
            os.fsync(file.fileno())
        if previous is not None and path.exists():
            path.replace(previous)
        temporary.replace(path)
        _flush(path.parent)
    finally:
        temporary.unlink(missing_ok=True)


def _write_all(descriptor: int, content: BytesIO) -> None:
    rest = content.getbuffer()
    while rest:  # the operating system may take a part at a time, the last one before it says what is wrong
        rest = rest[os.write(descriptor, rest) :]


def _flush(folder: Path) -> None:
    """Waits until the entries of the folder are on the disk."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
