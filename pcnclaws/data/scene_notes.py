"""What a scene is beside its particles, as plain values: for formats of particle arrays and one line of text."""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from pcnclaws.errors import UserError
from pcnclaws.laws.parameters import PARAMETERS, validate_parameters
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.mpm.transfer_orders import APIC
from pcnclaws.simulation.records import SceneRecord

# What begins the line of text.
MARK = "pcnclaws"
NUMBERS = ("time_step", "grid_spacing", "wall_distance", "density", "friction", "start_time")
SETTINGS = (*NUMBERS, "gravity", "domain", "boundary", "transfer")
# Longest accepted line: it is no place for data.
LONGEST = 20_000


def notes_of(record: SceneRecord) -> dict[str, Any]:
    """Name, material, parameters and settings of a scene by name; colliders and loads are not among them."""
    settings = record.settings
    numbers = {name: float(getattr(settings, name)) for name in NUMBERS}
    domain = settings.domain and [list(corner) for corner in settings.domain]
    words = {"name": record.name, "material": record.material, "boundary": settings.boundary}
    words |= {"transfer": settings.transfer} if settings.transfer != APIC else {}
    parameters = {name: float(value) for name, value in record.parameters.items()}
    return words | numbers | {"gravity": list(settings.gravity), "domain": domain} | parameters


def line_of(notes: Mapping[str, Any]) -> str:
    """The notes as one line of text, which notes_in_line reads."""
    return f"{MARK} {json.dumps(notes)}"


def notes_in_line(line: str, where: str) -> dict[str, Any]:
    """The notes of a line of text; none where it is another one.

    raises  UserError for a damaged line
    """
    if not line.startswith(f"{MARK} "):
        return {}
    try:
        notes = json.loads(line[len(MARK) :]) if len(line) <= LONGEST else None
    except (ValueError, RecursionError):
        notes = None
    if not isinstance(notes, dict):
        raise UserError(
            f"{where}: its line '{MARK} ...' is damaged; accepted: names and values in JSON, or no such line"
        )
    return notes


def settings_from_notes(notes: Mapping[str, Any], where: str) -> SimulationSettings:
    """The settings that notes give; those of the paper where they say nothing.

    raises  UserError for values that are not accepted
    """
    given: dict[str, Any] = {name: _array(notes[name], (), name, where).item() for name in NUMBERS if name in notes}
    if "gravity" in notes:
        given["gravity"] = tuple(_array(notes["gravity"], (3,), "gravity", where).tolist())
    if "domain" in notes:
        corners = notes["domain"]
        given["domain"] = (
            None if corners is None else tuple(map(tuple, _array(corners, (2, 3), "domain", where).tolist()))
        )
    if "boundary" in notes:
        given["boundary"] = str(notes["boundary"])
    if "transfer" in notes:
        given["transfer"] = str(notes["transfer"])
    try:
        return SimulationSettings(**given)
    except UserError as fault:
        raise UserError(f"{where}: {fault}") from fault


def parameters_from_notes(notes: Mapping[str, Any], where: str) -> dict[str, float]:
    """The physical parameters among notes.

    raises  UserError for values that are not accepted
    """
    found = {name: float(_array(notes[name], (), name, where)) for name in PARAMETERS if name in notes}
    try:
        validate_parameters(found, list(found))
    except UserError as fault:
        raise UserError(f"{where}: {fault}") from fault
    return found


def _array(value: Any, shape: tuple[int, ...], name: str, where: str) -> np.ndarray:
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        array = np.full(1, np.nan)
    if array.shape != shape or not np.isfinite(array).all():
        accepted = {(): "a finite number", (3,): "three finite numbers"}.get(
            shape, "two corners of three finite numbers"
        )
        raise UserError(f"{where}: '{name}' is not accepted; accepted: {accepted}")
    return array
