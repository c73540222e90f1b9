"""The two failures a user meets: wrong input, and a simulation that left the physical world."""

from collections.abc import Iterable
from difflib import get_close_matches


class UserError(ValueError):
    """The user's input is wrong. The message is one line: option, value, what is accepted. Exit status 2."""


class SimulationDiverged(RuntimeError):
    """A run produced a state that is not physical. The message names scene, step and particle. Exit status 1."""


class ParticleEscaped(SimulationDiverged):
    """A particle left the domain."""


def unknown_name(option: str, name: object, known: Iterable[str]) -> UserError:
    """The error for a name that is not in a table, with the nearest known name when one is close."""
    choices = sorted(known)
    close = get_close_matches(str(name), choices, n=1, cutoff=0.5)
    hint = f"; did you mean '{close[0]}'?" if close else ""
    return UserError(f"{option}='{name}' is not known; accepted: {', '.join(choices)}{hint}")
