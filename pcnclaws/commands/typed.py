"""Typed configurations: the checked options of a command, once composed, as one frozen value for all that follows."""

from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from typing import Any, TypeVar, get_type_hints

Config = TypeVar("Config")


def typed(kind: type[Config], options: Mapping[str, Any]) -> Config:
    """The options as an instance of a dataclass: groups are dataclasses of their own, or plain mappings.

    raises  TypeError for an option that has no field: names and kinds of what users write are checked before
    """
    hints = get_type_hints(kind)
    without = sorted(set(options) - set(hints))
    if without:
        raise TypeError(f"{kind.__name__} has no field for {', '.join(without)}")
    return kind(
        **{
            name: typed(hints[name], value) if is_dataclass(hints[name]) and isinstance(value, Mapping) else value
            for name, value in options.items()
        }
    )


def plain(config: object) -> dict[str, Any]:
    """The options as nested plain values, without those that the composition did not have."""
    values: dict[str, Any] = {}
    for field in fields(config):  # pyright: ignore[reportArgumentType]  # an instance of a dataclass
        value = getattr(config, field.name)
        if field.default is MISSING or value != field.default:
            values[field.name] = plain(value) if is_dataclass(value) else value
    return values
