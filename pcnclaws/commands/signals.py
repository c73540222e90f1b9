"""Signals: SIGINT and SIGTERM as one exception, so that whatever runs ends in order, with nothing half written."""

import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from pcnclaws.errors import Interrupted

SIGNALS = (signal.SIGINT, signal.SIGTERM)
# A second signal so soon after the first is the same one: `timeout` sends it to a process and to its group.
SAME = 1.0  # seconds
# How long after it was swallowed the exception is raised once more.
AGAIN = 0.05  # seconds


@contextmanager
def signals_end_it() -> Iterator[None]:
    """Raises Interrupted in the block at the first signal; a second one ends the process at once.

    Signals that the process was told to ignore (nohup) stay ignored.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    ending = _Ending()
    caught = [number for number in SIGNALS if signal.getsignal(number) is not signal.SIG_IGN]
    before = {number: signal.signal(number, ending.handle) for number in (*caught, signal.SIGALRM)}
    hook, sys.unraisablehook = sys.unraisablehook, ending.swallowed
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        sys.unraisablehook = hook
        for number, handler in before.items():
            signal.signal(number, handler)


class _Ending:
    """What a process does that was told to end."""

    def __init__(self) -> None:
        self._first: int | None = None
        self._when = 0.0
        self._hook = sys.unraisablehook

    def handle(self, number: int, frame: FrameType | None) -> None:
        """The handler of the signals, and of the alarm that follows when the exception was swallowed."""
        now = time.monotonic()
        if self._first is not None and number != signal.SIGALRM:
            if now - self._when > SAME:
                signal.signal(number, signal.SIG_DFL)
                signal.raise_signal(number)
            return
        if self._first is None:
            self._first, self._when = number, now
        raise Interrupted(self._first)

    def swallowed(self, unraisable: "sys.UnraisableHookArgs") -> None:
        """Python drops exceptions in destructors and callbacks: there, the signal would have been for nothing."""
        if isinstance(unraisable.exc_value, Interrupted):
            signal.setitimer(signal.ITIMER_REAL, AGAIN)
        else:
            self._hook(unraisable)
