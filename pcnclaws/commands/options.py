"""Accepted options of a configuration: known names, and values of the kind of their defaults."""

import math
from collections.abc import Iterator, Mapping
from typing import Any

from pcnclaws.errors import UserError, unknown_name

# Words that an option takes beside the numbers of its kind; None is null.
WORDS: Mapping[str, tuple[object, ...]] = {
    "simulation.time_step": ("auto",),
    "simulation.domain": (None,),
    "training.average": (None,),
    "training.batch_segments": (None,),
    "training.gradient_clip": (None,),
    "training.segment_length.first": (None,),
    "training.segment_length.last": (None,),
}
# Options that are null by default and yet of one kind.
OF_KIND = {"simulation.grid_nodes": 0}
KINDS = {bool: "true or false", int: "a whole number", float: "a finite number", str: "text"}
# Lists whose length is free: what a benchmark problem goes through. Other lists are vectors, as long as their default.
FREE_LISTS = "problem."
# Options that say where and how fast, not what: they may differ between a run and its continuation, and name no folder.
FREE_OPTIONS = (
    "overwrite",
    "plugins",
    "output",
    "paths",
    "name",
    "picture",
    "trajectory",
    "device",
    "threads",
    "logger",
    "data.folder",
    "simulation.backend",
    "simulation.skip",
    "trainer.accelerator",
    "trainer.devices",
    "trainer.strategy",
)
# Groups whose names are those of a library, which refuses the others: see training/loop.py.
OPEN_GROUPS = ("trainer.",)
# At most so many names are listed when an option is not known.
LISTED = 12


def leaves(options: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Every option by its dotted name, with its value: a scalar, a list, or None."""
    for key, value in options.items():
        if isinstance(value, Mapping) and value:
            yield from leaves(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def is_free(option: str) -> bool:
    """Whether an option, by its dotted name, is one of FREE_OPTIONS or below one."""
    return any(option == free or option.startswith(f"{free}.") for free in FREE_OPTIONS)


def check_options(values: Mapping[str, Any], defaults: Mapping[str, Any]) -> None:
    """Refuses unknown and deleted options and values of another kind than the default's with a UserError.

    A default of None says nothing about the kind; numbers are finite there too.
    """
    for option, value in values.items():
        if option not in defaults and _is_open(option, defaults):
            _require_kind(option, value, None)
            continue
        if option not in defaults:
            raise unknown_option(option, defaults)
        if value not in WORDS.get(option, ()):
            _require_kind(option, value, defaults[option])
    for option, default in defaults.items():
        if option not in values:
            raise UserError(f"option '{option}' is missing; accepted: {_accepted(default)}")


def _is_open(option: str, defaults: Mapping[str, Any]) -> bool:
    """Whether the option is of a group that takes any name, and that the command has."""
    group = next((group for group in OPEN_GROUPS if option.startswith(group)), None)
    return group is not None and any(known.startswith(group) for known in defaults)


def unknown_option(option: str, defaults: Mapping[str, Any]) -> UserError:
    """The error for an option that does not exist: its siblings, and the nearest name among all options."""
    siblings: list[str] = []
    prefix = option
    while not siblings and prefix:
        prefix = prefix.rpartition(".")[0]
        siblings = sorted(name for name in defaults if name.startswith(f"{prefix}." if prefix else ""))
    if len(siblings) > LISTED:
        level = prefix.count(".") + 2 if prefix else 1
        siblings = sorted({".".join(name.split(".")[:level]) for name in siblings})
    return unknown_name("option", option, siblings)


def _require_kind(option: str, value: Any, default: Any) -> None:
    if default is None and value is not None:
        default = OF_KIND.get(option)
    if default is None:
        right = all(not isinstance(item, float) or math.isfinite(item) for item in _items(value))
        accepted = "finite numbers"
    elif option.startswith(FREE_LISTS) and isinstance(default, list) and default:
        right = isinstance(value, list) and all(_is_kind(item, default[0]) for item in value)
        accepted = f"a list, each {_accepted(default[0])}"
    else:
        right, accepted = _is_kind(value, default), _accepted(default)
    if not right:
        words = "".join(f", or {_shown(word)}" for word in WORDS.get(option, ()))
        raise UserError(f"{option}={_shown(value)} is not accepted; accepted: {accepted}{words}")


def _is_kind(value: Any, default: Any) -> bool:
    if isinstance(default, list):
        return (
            isinstance(value, list)
            and (not default or len(value) == len(default))
            and all(_is_kind(item, default[0]) for item in value if default)
        )
    if isinstance(default, float):
        return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
    return type(value) is type(default)


def _accepted(default: Any) -> str:
    if isinstance(default, list) and default:
        return f"a list of {len(default)}, each {_accepted(default[0])}"
    return KINDS.get(type(default), "a list" if isinstance(default, list) else "a value")


def _items(value: Any) -> Iterator[Any]:
    if isinstance(value, Mapping):
        value = list(value.values())
    if isinstance(value, list):
        for item in value:
            yield from _items(item)
    else:
        yield value


def _shown(value: Any) -> str:
    return "null" if value is None else str(value).lower() if isinstance(value, bool) else str(value)
