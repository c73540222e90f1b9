"""Work in forked children: a reader that crashes, hangs or takes memory ends its child and is counted, and no more."""

import os
import resource
import select
import signal
import struct
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from pcnclaws.errors import UserError

SECONDS, BYTES = 10.0, 2 * 1024**3
# Outcomes: two are right.
READ, REFUSED = "read", "refused"
LINES, TRACEBACK, CRASHED, HUNG, MEMORY = "several lines", "traceback", "crashed", "hung", "out of memory"
FAULTS = (LINES, TRACEBACK, CRASHED, HUNG, MEMORY)
HEADER = struct.Struct("<dI")


class Outcome(NamedTuple):
    """What became of an input, in one word and in words, and how long it took [s]."""

    word: str
    text: str
    seconds: float


def outcomes(work: Callable[[int], None], numbers: Sequence[int]) -> Iterator[tuple[int, Outcome]]:
    """The outcomes of work on some inputs, one after the other, as many in one child as survive there.

    work  raises UserError to refuse an input; is called in a child, with time and memory limits
    """
    left = list(numbers)
    while left:
        done = 0
        for outcome in _of_one_child(work, left):
            yield left[done], outcome
            done += 1
        left = left[done:]


def _of_one_child(work: Callable[[int], None], numbers: Sequence[int]) -> Iterator[Outcome]:
    """Outcomes in order, up to the one that ends the child."""
    reading, writing = os.pipe()
    sys.stdout.flush()
    child = os.fork()
    if child == 0:
        os.close(reading)
        _work(work, numbers, writing)
    os.close(writing)
    ended, fault = 0, None
    with os.fdopen(reading, "rb", buffering=0) as pipe:
        for _ in numbers:
            began = time.monotonic()
            ready, _, _ = select.select([pipe], [], [], SECONDS)
            if not ready:
                fault = Outcome(HUNG, f"no answer within {SECONDS:g} s", SECONDS)
                break
            header = _exactly(pipe, HEADER.size)
            if header is None:
                fault = Outcome(CRASHED, "", time.monotonic() - began)
                break
            seconds, length = HEADER.unpack(header)
            word, _, text = (_exactly(pipe, length) or b"").decode(errors="replace").partition("\n")
            ended += 1
            yield Outcome(word, text, seconds)
    if fault is None:
        os.waitpid(child, 0)
        return
    os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    if fault.word == CRASHED:
        number = os.WTERMSIG(status) if os.WIFSIGNALED(status) else 0
        fault = fault._replace(
            text=signal.Signals(number).name if number else f"exit {os.waitstatus_to_exitcode(status)}"
        )
    yield fault


def _work(work: Callable[[int], None], numbers: Sequence[int], writing: int) -> None:
    """Works in the child, and never returns."""
    try:
        used = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + BYTES, used + BYTES))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        silent = os.open(os.devnull, os.O_WRONLY)
        for stream in (1, 2):
            os.dup2(silent, stream)
        warnings.simplefilter("ignore")
        for number in numbers:
            began = time.monotonic()
            word, text = _outcome(work, number)
            said = f"{word}\n{text[:500]}".encode(errors="replace")
            os.write(writing, HEADER.pack(time.monotonic() - began, len(said)) + said)
    finally:
        os._exit(0)


def _outcome(work: Callable[[int], None], number: int) -> tuple[str, str]:
    try:
        work(number)
    except UserError as error:
        return (LINES if "\n" in str(error).strip() else REFUSED), str(error)
    except MemoryError as error:
        return MEMORY, repr(error)
    except Exception as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        return TRACEBACK, f"{type(error).__name__}: {error} ({Path(last.filename).name}:{last.lineno})"
    return READ, ""


def _exactly(pipe: object, length: int) -> bytes | None:
    """So many bytes of the pipe; None where it ends before."""
    content = b""
    while len(content) < length:
        part = pipe.read(length - len(content))  # pyright: ignore[reportAttributeAccessIssue]
        if not part:
            return None
        content += part
    return content
