"""Scene records as plain values, arrays among them, and back: what a child that read a file sends."""

from dataclasses import fields
from typing import Any

from pcnclaws.mpm.colliders import Collider
from pcnclaws.mpm.loads import Load
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.simulation.records import Keyframes, SceneRecord


def plain_record(record: SceneRecord) -> dict[str, Any]:
    """The record in plain values."""
    keyframes, settings = record.keyframes, _fields(record.settings)
    settings |= {name: [one.to_options() for one in settings[name]] for name in ("colliders", "loads")}
    states = None if keyframes is None else _fields(keyframes) | {"internal": dict(keyframes.internal)}
    return _fields(record) | {"settings": settings, "parameters": dict(record.parameters), "keyframes": states}


def record_from(plain: dict[str, Any]) -> SceneRecord:
    """The record of plain values.

    raises  UserError for settings that are not accepted
    """
    keyframes = plain["keyframes"]
    states = None if keyframes is None else Keyframes(**keyframes)
    return SceneRecord(**plain | {"settings": _settings(plain["settings"]), "keyframes": states})


def _settings(plain: dict[str, Any]) -> SimulationSettings:
    domain = plain["domain"]
    tuples = {
        "gravity": tuple(plain["gravity"]),
        "domain": None if domain is None else tuple(map(tuple, domain)),
        "colliders": tuple(Collider.from_options(options) for options in plain["colliders"]),
        "loads": tuple(Load.from_options(options) for options in plain["loads"]),
    }
    return SimulationSettings(**plain | tuples)


def _fields(owner: Any) -> dict[str, Any]:
    return {one.name: getattr(owner, one.name) for one in fields(owner)}
