"""Files that appear whole or not at all."""

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pcnclaws.errors import UserError

PARTIAL_SUFFIX = ".partial"


@contextmanager
def replaced_file(path: str | Path) -> Iterator[Path]:
    """A temporary file beside `path` that takes its place when the block ends well, and is removed otherwise.

    Folders above it are made. A killed process leaves at most a hidden file that ends in PARTIAL_SUFFIX.
    raises  UserError when nothing can be written there
    """
    path = Path(os.path.realpath(path))  # a link stays a link: its target is replaced
    temporary = path.with_name(f".{path.name[:100]}.{secrets.token_hex(4)}{PARTIAL_SUFFIX}")
    try:
        if path.is_dir():
            raise IsADirectoryError(None, "is a folder", str(path))
        if path.exists() and not path.is_file():
            raise OSError(None, "is not a regular file", str(path))
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary.touch(exist_ok=False)
    except OSError as error:
        reason = error.strerror or error
        raise UserError(f"{path}: cannot be written ({reason}); accepted: the path of a file") from error
    try:
        yield temporary
        _flush(temporary)
        temporary.replace(path)
        _flush(path.parent)
    finally:
        temporary.unlink(missing_ok=True)


def remove_partial_files(folder: Path) -> None:
    """Removes what killed processes left in a folder; only safe while nobody else writes there."""
    for leftover in folder.glob(f".*{PARTIAL_SUFFIX}"):
        leftover.unlink(missing_ok=True)


def _flush(path: Path) -> None:
    """Waits until the file, or the entries of the folder, are on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
