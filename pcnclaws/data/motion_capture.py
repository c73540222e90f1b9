"""Motion capture: a file of markers in units, frame and clock of its own, brought to those of the simulation."""

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from pcnclaws.data.c3d_files import ENDING, read_c3d, units_of
from pcnclaws.data.length_units import UNITS
from pcnclaws.data.marker_tables import read_table
from pcnclaws.data.registration import Registration, by_fixed_markers, on_shape
from pcnclaws.errors import UserError, unknown_name

log = logging.getLogger(__name__)

# Frames within this of the start are at the start [s].
AT_START = 1e-6
# Markers that are this much farther from the others than these are from one another are in another unit.
MIXED = 50.0


@dataclass(frozen=True)
class Capture:
    """How a file of motion capture is to be read.

    units      of its lengths, one of UNITS; None for those that a C3D file says, and metres of a table
    places     of its fixed markers in the simulation's frame [m], by name
    on_shape   lay the markers of the start on the surface of the body instead
    start      of the simulation, on the clock of the file [s]; markers have their places on the body in the frames up
               to it, their median
    """

    units: str | None = None
    places: Mapping[str, Float[np.ndarray, "3"]] | None = None
    on_shape: bool = False
    start: float | None = None


def captured(
    path: Path, body: Float[np.ndarray, "particles 3"], reach: float, capture: Capture | None
) -> tuple[np.ndarray, list[str], Float[np.ndarray, "frames markers 3"], Registration | None]:
    """Times since the start [s], names, positions in the simulation's frame [m], and how the frame was found.

    Fixed markers that are not on the body are left out.
    body    the particles at the start [m]
    reach   largest accepted distance of a marker from the body [m]
    raises  UserError
    """
    time, names, target, units = _read(path, None if capture is None else capture.units)
    target = UNITS[units] * target
    if capture is None:
        return time, names, target, None
    if capture.start is not None:
        time, target = _from_start(path, time, target, capture.start)
    _require_one_unit(path, names, target[0])
    if capture.places is None and not capture.on_shape:
        return time, names, target, None
    if capture.places is not None:
        registration = _by_places(path, names, target, capture.places, units)
    else:
        seen = np.isfinite(target[0]).all(1)
        known = [name for name, one in zip(names, seen, strict=True) if one]
        registration = on_shape(str(path), target[0, seen], known, body, reach, units=units)
    target = registration(target)
    names, target = _on_body(path, names, target, body, reach, capture=capture)
    log.warning("%s: %s", path, registration.words())
    return time, names, target, registration


def _read(path: Path, units: str | None) -> tuple[np.ndarray, list[str], Float[np.ndarray, "frames markers 3"], str]:
    """Times, names and positions of a file, and their unit."""
    if path.suffix.lower() == ENDING:
        time, names, target, said = read_c3d(path)
        return time, names, target, units_of(path, said, units)
    return *read_table(path), units or "m"


def _from_start(
    path: Path, time: np.ndarray, target: Float[np.ndarray, "frames markers 3"], start: float
) -> tuple[np.ndarray, Float[np.ndarray, "later markers 3"]]:
    """Times since the start; the first frame is the median of those up to it."""
    before = time <= start + AT_START
    if not before.any() or before.all():
        raise UserError(
            f"observation.start={start:g} leaves no frame on one side of it; accepted: {time[0]:g} to "
            f"{time[-1]:g} s, the times of {path}"
        )
    seen = np.isfinite(target[before]).all(2).any(0)
    first = np.full(target.shape[1:], np.nan)
    first[seen] = np.nanmedian(target[before][:, seen], axis=0)
    return np.append(0.0, time[~before] - start), np.concatenate((first[None], target[~before]))


def _require_one_unit(path: Path, names: list[str], first: Float[np.ndarray, "markers 3"]) -> None:
    """Refuses markers whose coordinates are another order of magnitude than those of the others."""
    seen = np.flatnonzero(np.isfinite(first).all(1))
    if len(seen) < 4:
        return
    size = np.linalg.norm(first[seen], axis=1)
    middle = float(np.median(size))
    factor = np.maximum(size, 1e-9) / max(middle, 1e-9)
    worst = int(np.argmax(factor))
    if factor[worst] > MIXED:
        raise UserError(
            f"{path}: marker '{names[seen[worst]]}' is {size[worst]:.3g} m from the origin and most are {middle:.3g} m"
            "; accepted: one unit for all markers; mixed units?"
        )


def _by_places(
    path: Path,
    names: list[str],
    target: Float[np.ndarray, "frames markers 3"],
    places: Mapping[str, Float[np.ndarray, "3"]],
    units: str,
) -> Registration:
    for name in places:
        if name not in names:
            raise unknown_name("observation.frame", name, names)
        if not np.isfinite(target[0, names.index(name)]).all():
            raise UserError(
                f"{path}: marker '{name}' of observation.frame is not seen at the start; accepted: one that is"
            )
    chosen = [*places]
    marker = np.array([target[0, names.index(name)] for name in chosen]).reshape(-1, 3)
    return by_fixed_markers(
        str(path), marker, np.array([places[name] for name in chosen]).reshape(-1, 3), chosen, units
    )


def _on_body(
    path: Path,
    names: list[str],
    target: Float[np.ndarray, "frames markers 3"],
    body: Float[np.ndarray, "particles 3"],
    reach: float,
    capture: Capture,
) -> tuple[list[str], Float[np.ndarray, "frames kept 3"]]:
    """Without fixed markers beside the body; UserError where the others are on it in a mirror alone."""
    if capture.places is None:
        return names, target
    first, tree = target[0], KDTree(body)
    away = np.full(len(names), np.nan)
    seen = np.isfinite(first).all(1)
    away[seen] = tree.query(first[seen])[0]
    kept = [k for k, name in enumerate(names) if not (name in capture.places and away[k] > reach)]
    if not kept:
        raise UserError(f"{path}: all of its markers are fixed ones beside the body; accepted: one or more on it")
    fixed = np.array(list(capture.places.values()))
    normal = np.linalg.svd(fixed - fixed.mean(0))[2][2]
    others = first[[k for k in kept if seen[k]]]
    mirrored = others - 2.0 * ((others - fixed.mean(0)) @ normal)[:, None] * normal
    if len(others) and tree.query(others)[0].max() > reach >= tree.query(mirrored)[0].max():
        raise UserError(
            f"{path}: its markers are {tree.query(others)[0].max():.3g} m from the body, and on it in a mirror; "
            "accepted: a frame that is not mirrored; is an axis turned around?"
        )
    return [names[k] for k in kept], target[:, kept]
