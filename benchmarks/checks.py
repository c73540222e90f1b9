"""What the options of a benchmark problem accept beyond their kind."""

import math
from collections.abc import Iterable, Mapping
from typing import Any

from pcnclaws.errors import UserError, unknown_name


def whole(options: Mapping[str, Any], name: str, least: int = 1) -> int:
    """The value of problem.<name>, a whole number of at least `least`; UserError otherwise."""
    return _whole(options[name], f"problem.{name}", least)


def wholes(options: Mapping[str, Any], name: str, least: int = 1, most: int | None = None) -> list[int]:
    """The values of the list problem.<name>, whole numbers of `least` to `most`; UserError otherwise."""
    return [_whole(value, f"problem.{name}", least, most) for value in options[name]]


def numbers(options: Mapping[str, Any], name: str, above: float, below: float = math.inf) -> list[float]:
    """The values of the list problem.<name>, at least one, each between the bounds; UserError otherwise."""
    limit = f"numbers above {above:g}" + ("" if math.isinf(below) else f" and below {below:g}")
    for value in options[name]:
        if not above < value < below:
            raise UserError(f"problem.{name}: {value} is not accepted; accepted: {limit}")
    if not options[name]:
        raise UserError(f"problem.{name}=[] is not accepted; accepted: one or more {limit}")
    return [float(value) for value in options[name]]


def names(options: Mapping[str, Any], name: str, known: Iterable[str]) -> list[str]:
    """The values of the list problem.<name>, all of them known and at least one; UserError otherwise."""
    choices = list(known)
    for value in options[name]:
        if value not in choices:
            raise unknown_name(f"problem.{name}", value, choices)
    if not options[name]:
        raise UserError(f"problem.{name}=[] is not accepted; accepted: one or more of {', '.join(choices)}")
    return list(options[name])


def _whole(value: Any, option: str, least: int, most: int | None = None) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < least or (most is not None and value > most):
        limit = f"from {least}" if most is None else f"from {least} to {most}"
        raise UserError(f"{option}: {value} is not accepted; accepted: whole numbers {limit}")
    return value
