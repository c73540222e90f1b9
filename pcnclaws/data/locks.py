"""Locks of folders: one process at a time writes there. The lock of a process that was killed is gone with it."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from pcnclaws.atomic import one_line_writing
from pcnclaws.errors import UserError

log = logging.getLogger(__name__)

LOCK = ".lock"


@contextmanager
def written_alone(folder: Path, option: str) -> Iterator[None]:
    """Makes the folder and locks it for the block; what is new and still empty then is removed.

    option  what names the folder, for the message, as in 'output=run'
    raises  UserError while another process has the lock
    """
    if folder.exists() and not folder.is_dir():
        raise UserError(f"{option}: {folder} is a file; accepted: a folder")
    file, made = folder / LOCK, [path for path in (folder, *folder.parents) if not path.exists()]
    lock = FileLock(file)
    with one_line_writing(file):
        folder.mkdir(parents=True, exist_ok=True)
        try:
            lock.acquire(timeout=0)
        except Timeout:
            raise UserError(
                f"{option} is being written by another process; accepted: another one, or the same when that has ended"
            ) from None
    try:
        yield
    finally:
        file.unlink(missing_ok=True)  # before the release, while nobody else has it
        with suppress(OSError):  # the first one that is not empty
            for path in made:
                path.rmdir()
        lock.release()


@contextmanager
def one_after_another(folder: Path) -> Iterator[None]:
    """Locks a folder that exists for the block, and waits, with a word, while another process has the lock."""
    lock = FileLock(folder / LOCK)
    with one_line_writing(folder / LOCK):
        try:
            lock.acquire(timeout=0)
        except Timeout:
            log.warning("another process writes in %s: waiting until it has ended", folder)
            lock.acquire()
    try:
        yield
    finally:
        lock.release()
