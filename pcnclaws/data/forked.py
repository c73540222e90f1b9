"""Work in a forked child, whose result comes back through a pipe: what crashes or hangs there ends the child alone.

What the child sends is not trusted either: a file that it parsed may have made it run anything. It is read as plain
values, not unpickled.
"""

import faulthandler
import logging
import os
import select
import signal
import time
import traceback
import warnings
from collections.abc import Callable
from contextlib import suppress
from typing import Any, NoReturn, TypeVar

from pcnclaws.data.plain_messages import NotAMessage, from_message, to_message
from pcnclaws.data.room import free_bytes
from pcnclaws.errors import UserError

Result = TypeVar("Result")

NUMBER = 8  # bytes of a length
BLOCK = 2**20
MOST_PARTS = 10**6


class ChildFailed(RuntimeError):
    """The child ended without a result. The message says of what: a signal, or the time it took."""


def in_child(work: Callable[[], Result], seconds: float) -> Result:
    """The result of work that a forked child does; what it logs is logged here, what it raises is raised here.

    work     returns plain values, see plain_messages; tuples come back as lists
    seconds  that the child may take
    raises   ChildFailed, also for a child that sends something else; UserError of the work, and RuntimeError with
             its words for any other error
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
        message = _received(reading, time.monotonic() + seconds)
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
    return _told(message)


def _told(message: list[bytearray]) -> Any:
    """The result of a message, after its lines of the log; raises its error."""
    try:
        found = from_message(message)
        result, error, lines = found["result"], found["error"], found["log"]
        lines = [(str(name), int(level), str(text)) for name, level, text in lines]
        kind, text, trace = (None, "", "") if error is None else map(str, error)
    except (NotAMessage, TypeError, ValueError, LookupError, OverflowError) as fault:
        raise ChildFailed("what it sends is no result") from fault
    for name, level, said in lines:
        logging.getLogger(name).log(level, "%s", said)
    if kind == UserError.__name__:
        raise UserError(text)
    if kind is not None:
        fault = RuntimeError(f"{kind}: {text}")
        fault.add_note(trace)
        raise fault
    return result


def _fate(child: int) -> str:
    _, status = os.waitpid(child, 0)
    return signal.Signals(os.WTERMSIG(status)).name if os.WIFSIGNALED(status) else "no result"


class _Kept(logging.Handler):
    """Keeps what is logged: logger, level and text."""

    def __init__(self) -> None:
        super().__init__()
        self.lines: list[tuple[str, int, str]] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.lines.append((record.name, record.levelno, record.getMessage()))


def _work(work: Callable[[], object], writing: int) -> NoReturn:
    """Does the work in the child, sends what became of it, and never returns."""
    try:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_DFL)
        faulthandler.disable()
        kept = _Kept()
        logging.getLogger().handlers[:] = [kept]
        result: object = None
        error: tuple[str, str, str] | None = None
        try:
            result = work()
        except UserError as fault:
            error = UserError.__name__, str(fault), ""
        except Exception as fault:
            error = type(fault).__name__, str(fault), traceback.format_exc()
        _send(writing, {"result": result, "error": error, "log": kept.lines})
    finally:
        os._exit(0)


def _send(writing: int, found: object) -> None:
    views = to_message(found)
    sizes = b"".join(view.nbytes.to_bytes(NUMBER, "little") for view in views)
    for view in (memoryview(len(views).to_bytes(NUMBER, "little") + sizes), *views):
        sent = 0
        while sent < view.nbytes:
            sent += os.write(writing, view[sent : sent + BLOCK])


def _received(reading: int, end: float) -> list[bytearray]:
    """The parts that the child sent; EOFError where it ended before, TimeoutError where they are not there in time."""
    (count,) = _numbers(reading, 1, end)
    if count > MOST_PARTS:
        raise ChildFailed("what it sends is no result")
    sizes, free = _numbers(reading, count, end), free_bytes()
    if free is not None and sum(sizes) > free:
        raise ChildFailed("its result does not fit the memory here")
    return [_exactly(reading, size, end) for size in sizes]


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
