"""The settings of a scene in a trajectory file: what stands around its bodies, in either version of the format.

A scene in the unit box with the walls of version 1 and nothing else around it can be written in version 1.
"""

import hashlib
from typing import Any

import h5py
import numpy as np

from pcnclaws.data.guarded_hdf5 import GuardedGroup
from pcnclaws.errors import unknown_name
from pcnclaws.mpm.colliders import Collider
from pcnclaws.mpm.contact import CONTACTS, VERSION_1_STICK
from pcnclaws.mpm.loads import Load
from pcnclaws.mpm.settings import UNIT_BOX, SimulationSettings
from pcnclaws.mpm.transfer_orders import APIC, require_transfer

VERSIONS = (1, 2)
# What version 1 calls the contacts of its walls.
VERSION_1_WORDS = {"slip": "separate", "stick": VERSION_1_STICK}
WALLS = 6


def version_of(settings: SimulationSettings) -> int:
    """The first version of the format that can hold these settings."""
    around = settings.friction > 0.0 or settings.colliders or settings.loads or settings.start_time
    others = around or settings.transfer != APIC
    known = settings.domain == UNIT_BOX and settings.boundary in VERSION_1_WORDS.values()
    return 1 if known and not others else 2


def described_settings(settings: SimulationSettings) -> dict[str, Any]:
    """The settings in plain types, in the words of the first version that can hold them: equal for equal settings."""
    names = ("time_step", "wall_distance", "density")
    same = {name: getattr(settings, name) for name in names} | {"gravity": list(settings.gravity)}
    if version_of(settings) == 1 and settings.cells is not None:
        return same | {"grid_nodes": settings.cells[0], "boundary": _version_1_word(settings)}
    later = {"start_time": settings.start_time} if settings.start_time else {}
    later |= {"transfer": settings.transfer} if settings.transfer != APIC else {}
    return (
        same
        | later
        | {
            "grid_spacing": settings.grid_spacing,
            "boundary": settings.boundary,
            "friction": settings.friction,
            "domain": settings.domain and [list(corner) for corner in settings.domain],
            "colliders": [_without_arrays(collider.to_options()) for collider in settings.colliders],
            "loads": [load.to_options() for load in settings.loads],
        }
    )


def read_settings(group: GuardedGroup, version: int) -> SimulationSettings:
    """The settings of a scene."""
    return _read_version_1(group) if version == 1 else _read_version_2(group)


def write_settings(group: h5py.Group, settings: SimulationSettings, version: int) -> None:
    """Writes the settings of a scene."""
    for name in ("time_step", "grid_spacing", "wall_distance", "density"):
        group.attrs[name] = getattr(settings, name)
    group.attrs["gravity"] = np.array(settings.gravity)
    if version == 1 and settings.cells is not None:
        group.attrs["grid_nodes"] = settings.cells[0]
        group.attrs["boundary"] = _version_1_word(settings)
        return
    group.attrs["walls"] = ", ".join([settings.boundary] * WALLS)
    group.attrs["friction"] = settings.friction
    if settings.start_time:
        group.attrs["start_time"] = settings.start_time
    if settings.transfer != APIC:
        group.attrs["transfer"] = settings.transfer
    if settings.domain is not None:
        group.attrs["domain"] = np.array(settings.domain)
    for name, things in (("colliders", settings.colliders), ("loads", settings.loads)):
        for number, thing in enumerate(things):
            _write_options(group.require_group(name).create_group(str(number)), thing.to_options())


def _version_1_word(settings: SimulationSettings) -> str:
    return next(word for word, new in VERSION_1_WORDS.items() if new == settings.boundary)


def _read_version_1(group: GuardedGroup) -> SimulationSettings:
    nodes = group.whole_number("grid_nodes")
    if nodes < 1:
        raise group.fault(f"@grid_nodes={nodes} is out of range; accepted: a whole number from 4")
    word = group.text("boundary")
    if word not in VERSION_1_WORDS:
        raise unknown_name("@boundary", word, VERSION_1_WORDS)
    settings = SimulationSettings(
        time_step=group.number("time_step"),
        grid_spacing=1.0 / nodes,
        wall_distance=group.number("wall_distance"),
        gravity=group.vector("gravity"),
        boundary=VERSION_1_WORDS[word],
        density=group.number("density"),
    )
    if group.has_attribute("grid_spacing"):
        spacing = group.number("grid_spacing")
        if abs(spacing * nodes - 1.0) > 1e-4:
            raise group.fault(
                f"@grid_spacing={spacing:g} does not fit @grid_nodes={nodes}; accepted: {settings.grid_spacing:g}"
            )
    return settings


def _read_version_2(group: GuardedGroup) -> SimulationSettings:
    walls = [word.strip() for word in group.text("walls").split(",")]
    if len(walls) != WALLS or len(set(walls)) > 1:
        raise group.fault(f"@walls='{', '.join(walls)}' is not accepted; accepted: the same contact of six walls")
    if walls[0] not in (*CONTACTS, VERSION_1_STICK):
        raise unknown_name("@walls", walls[0], CONTACTS)
    domain = group.numbers("domain", (2, 3)).tolist() if group.has_attribute("domain") else None
    colliders = [
        Collider.from_options(options, f"colliders/{number}")
        for number, options in enumerate(_read_all(group, "colliders"))
    ]
    loads = [Load.from_options(options, f"loads/{number}") for number, options in enumerate(_read_all(group, "loads"))]
    return SimulationSettings(
        time_step=group.number("time_step"),
        grid_spacing=group.number("grid_spacing"),
        wall_distance=group.number("wall_distance"),
        gravity=group.vector("gravity"),
        boundary=walls[0],
        density=group.number("density"),
        domain=None if domain is None else (tuple(domain[0]), tuple(domain[1])),
        friction=group.number("friction"),
        colliders=tuple(colliders),
        loads=tuple(loads),
        start_time=group.number("start_time") if group.has_attribute("start_time") else 0.0,
        transfer=_read_transfer(group),
    )


def _read_transfer(group: GuardedGroup) -> str:
    if not group.has_attribute("transfer"):
        return APIC
    transfer = group.text("transfer")
    require_transfer("@transfer", transfer)
    return transfer


def _read_all(group: GuardedGroup, name: str) -> list[dict[str, Any]]:
    """The options of all colliders or loads, in their order."""
    if name not in group:
        return []
    members = group.group(name)
    one_by_one = sorted(members.names(), key=lambda text: (len(text), text))
    return [_options_of(members.group(number)) for number in one_by_one]


def _options_of(group: GuardedGroup) -> dict[str, Any]:
    """Numbers, words and arrays by name."""
    return group.options() | {name: group.array(name, (None, None, None)) for name in group.names()}


def _without_arrays(options: dict[str, Any]) -> dict[str, Any]:
    """The options with the digests of arrays in their places."""
    return {
        name: hashlib.blake2b(value.tobytes(), digest_size=16).hexdigest() if isinstance(value, np.ndarray) else value
        for name, value in options.items()
    }


def _write_options(group: h5py.Group, options: dict[str, Any]) -> None:
    for name, value in options.items():
        if isinstance(value, np.ndarray):
            group.create_dataset(name, data=value, compression="gzip", shuffle=True, fletcher32=True)
        elif value is not None:
            group.attrs[name] = value
