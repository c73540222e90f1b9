"""Failures that a user meets: wrong input, a simulation that left the physical world, a full disk, an interruption."""

import errno
import signal
from collections.abc import Iterable
from difflib import get_close_matches


class UserError(ValueError):
    """The user's input is wrong. The message is one line: option, value, what is accepted. Exit status 2."""


class SimulationDiverged(RuntimeError):
    """A run produced a state that is not physical. The message names scene, step and particle. Exit status 1."""


class ParticleEscaped(SimulationDiverged):
    """A particle left the domain."""


class CannotWrite(RuntimeError):
    """There is no room for a file. The message is one line: the file and what the system says. Exit status 1."""


class JobsLost(RuntimeError):
    """Processes of a sweep ended before their jobs did. The message is one line. Exit status 1."""


class Interrupted(BaseException):
    """The process was told to end by a signal. Exit status 1 for SIGINT (Ctrl-C), 143 for SIGTERM.

    Notes that are added to it say what was kept.
    """

    def __init__(self, number: int) -> None:
        super().__init__("terminated" if number == signal.SIGTERM else "interrupted")
        self.number = number


# What the operating system says where there is no room: the disk or a quota is full, a file may not become so large,
# the device fails.
NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)


def is_full(error: OSError) -> bool:
    """Whether it is the room for a file that is missing, and nothing is wrong with its path."""
    return error.errno in NO_ROOM


def reason(error: OSError) -> str:
    """What the operating system says, as the end of a sentence."""
    text = error.strerror or str(error)
    return f"{text[:1].lower()}{text[1:]}"


def not_installed(feature: str, package: str, extra: str, otherwise: str) -> UserError:
    """The error for a package that only some features need, with the command that installs it.

    extra      the name under [project.optional-dependencies] in pyproject.toml that brings the package
    otherwise  what is accepted without it
    """
    return UserError(
        f"{feature} needs {package}, which is not installed; accepted: pip install 'pcnclaws[{extra}]', or {otherwise}"
    )


def unknown_name(option: str, name: object, known: Iterable[str], more: str = "") -> UserError:
    """The error for a name that is not in a table, with the nearest known name when one is close, or else `more`."""
    choices = sorted(known)
    close = get_close_matches(str(name), choices, n=1, cutoff=0.5)
    hint = f"; did you mean '{close[0]}'?" if close else more and f"; {more}"
    return UserError(f"{option}='{name}' is not known; accepted: {', '.join(choices)}{hint}")
