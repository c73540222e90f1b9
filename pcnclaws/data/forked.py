"""Work in a forked child, whose result comes back through a pipe: what crashes or hangs there ends the child alone."""

import faulthandler
import logging
import os
import pickle
import select
import signal
import time
import warnings
from collections.abc import Callable
from contextlib import suppress
from typing import Any, NoReturn, TypeVar

Result = TypeVar("Result")

NUMBER = 8  # bytes of a length
BLOCK = 2**20


class ChildFailed(RuntimeError):
    """The child ended without a result. The message says of what: a signal, or the time it took."""


def in_child(work: Callable[[], Result], seconds: float) -> Result:
    """The result of work that a forked child does; what it logs is logged here, what it raises is raised here.

    The pipe carries pickles of our own process: what a file holds goes through it as arrays and text.
    seconds  that the child may take
    raises   ChildFailed
    """
    if not hasattr(os, "fork"):
        return work()
    reading, writing = os.pipe()
    with warnings.catch_warnings():
        # Python warns of threads: the child runs none of their code
        warnings.simplefilter("ignore", DeprecationWarning)
        child = os.fork()
    if child == 0:
        os.close(reading)
        _work(work, writing)
    os.close(writing)
    ended = False
    try:
        found = _received(reading, time.monotonic() + seconds)
        ended = True
    except TimeoutError:
        raise ChildFailed(f"no end within {seconds:.3g} s") from None
    except EOFError:
        ended = True
        raise ChildFailed(_fate(child)) from None
    finally:  # an interruption, too, ends the child
        os.close(reading)
        if not ended:
            os.kill(child, signal.SIGKILL)
        with suppress(ChildProcessError):
            os.waitpid(child, 0)
    result, error, records = found
    for record in records:
        logging.getLogger(record.name).handle(record)
    if error is not None:
        raise error
    return result


def _fate(child: int) -> str:
    _, status = os.waitpid(child, 0)
    return signal.Signals(os.WTERMSIG(status)).name if os.WIFSIGNALED(status) else "no result"


class _Kept(logging.Handler):
    """Keeps what is logged, with its text made."""

    def __init__(self) -> None:
        super().__init__()
        self.records: list[logging.LogRecord] = []

    def emit(self, record: logging.LogRecord) -> None:
        record.msg, record.args, record.exc_info = record.getMessage(), None, None
        self.records.append(record)


def _work(work: Callable[[], object], writing: int) -> NoReturn:
    """Does the work in the child, sends what became of it, and never returns."""
    try:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_DFL)
        faulthandler.disable()
        kept = _Kept()
        logging.getLogger().handlers[:] = [kept]
        result: object = None
        error: Exception | None = None
        try:
            result = work()
        except Exception as fault:
            error = fault.with_traceback(None)
            error.__cause__ = error.__context__ = None
        _send(writing, (result, error, kept.records))
    finally:
        os._exit(0)


def _send(writing: int, found: object) -> None:
    buffers: list[pickle.PickleBuffer] = []
    head = pickle.dumps(found, protocol=5, buffer_callback=buffers.append)
    views = [memoryview(head), *(one.raw() for one in buffers)]
    sizes = b"".join(view.nbytes.to_bytes(NUMBER, "little") for view in views)
    for view in (memoryview(len(views).to_bytes(NUMBER, "little") + sizes), *views):
        sent = 0
        while sent < view.nbytes:
            sent += os.write(writing, view[sent : sent + BLOCK])


def _received(reading: int, end: float) -> Any:
    """What the child sent; EOFError where it ended before, TimeoutError where it is not there in time."""
    (count,) = _numbers(reading, 1, end)
    head, *buffers = [_exactly(reading, size, end) for size in _numbers(reading, count, end)]
    return pickle.loads(head, buffers=buffers)  # noqa: S301  # of our own child


def _numbers(reading: int, count: int, end: float) -> list[int]:
    content = _exactly(reading, NUMBER * count, end)
    return [int.from_bytes(content[k : k + NUMBER], "little") for k in range(0, len(content), NUMBER)]


def _exactly(reading: int, size: int, end: float) -> bytearray:
    content, got = bytearray(size), 0
    while got < size:
        ready, _, _ = select.select([reading], [], [], max(end - time.monotonic(), 0.0))
        if not ready:
            raise TimeoutError
        part = os.readv(reading, [memoryview(content)[got : got + BLOCK]])
        if not part:
            raise EOFError
        got += part
    return content
