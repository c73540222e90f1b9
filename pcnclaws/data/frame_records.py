"""Scene records from frames of particles that other programs, or our own export, have written."""

import logging
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import KDTree

from pcnclaws.data.scene_notes import parameters_from_notes, settings_from_notes
from pcnclaws.errors import UserError
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.laws.parameters import PARAMETERS
from pcnclaws.simulation.placement import require_volume
from pcnclaws.simulation.records import SceneRecord

log = logging.getLogger(__name__)

LONGEST_TIME = 1e9
# With fewer their distances tell no volume.
FEWEST_PARTICLES = 8
# Fields that are read, with the shapes of what they hold of a particle.
READ: Mapping[str, tuple[int, ...]] = {
    "id": (),
    "velocity": (3,),
    "volume": (),
    "density": (),
    "initial_affine": (3, 3),
    **dict.fromkeys(PARAMETERS, ()),
}


class Frame(NamedTuple):
    """A frame of a file.

    time      [s]
    position  [m], (particles, 3)
    fields    those of READ that the file holds, each (particles, ...)
    notes     what the file says of the scene
    """

    time: float
    position: np.ndarray
    fields: Mapping[str, np.ndarray]
    notes: Mapping[str, Any]


def record_of(frames: Sequence[Frame], path: Path, name: str, material: str) -> SceneRecord:
    """The scene that the frames show. Particles that a later frame does not hold, by their ids, were not seen in it.

    Without notes the settings are those of the paper; parameters are fields that are the same for all particles. The
    restart states of a trajectory file are in no other format. Without volumes all particles have the same.
    raises  UserError, one line, for whatever is wrong
    """
    where, first = str(path), frames[0]
    time = np.array([frame.time for frame in frames])
    if not np.all(np.abs(time) < LONGEST_TIME) or np.any(np.diff(time) <= 0.0):
        raise UserError(f"{where}: its times are not increasing, or not below {LONGEST_TIME:g} s")
    places = [_places(frame, first, number, where) for number, frame in enumerate(frames)]
    position = _gathered([frame.position for frame in frames], places)
    velocity = None
    if all("velocity" in frame.fields for frame in frames):
        velocity = _gathered([frame.fields["velocity"] for frame in frames], places)
    start = first.fields.get("velocity")
    notes = {**_common_parameters(first, where), **first.notes}
    volume, density, affine = (first.fields.get(one) for one in ("volume", "density", "initial_affine"))
    _check(where, position=position, volume=volume, density=density, velocity=start, initial_affine=affine)
    if volume is None:
        volume = _equal_volumes(first.position, where)
    if density is not None and "density" not in notes and np.all(density == density[0]):
        notes["density"] = float(density[0])
    known = MATERIALS.get(str(notes.get("material", material)))
    settings = settings_from_notes(({} if known is None else {"density": known.density}) | notes, where)
    require_volume(volume, settings, where)
    uniform = density is None or np.all(density == density.dtype.type(settings.density))
    return SceneRecord(
        str(notes.get("name", name)),
        str(notes.get("material", material)),
        settings,
        parameters_from_notes(notes, where),
        time=time,
        position=position,
        volume=volume,
        initial_velocity=start,
        velocity=velocity if velocity is not None and np.isfinite(velocity).all() else None,
        source=where,
        initial_affine=affine,
        density=None if uniform else density,
    )


def checked_fields(fields: Mapping[str, np.ndarray], count: int, where: str) -> dict[str, np.ndarray]:
    """The fields that are read, in the shapes that they have; others are left out.

    raises  UserError for one of another shape
    """
    found = {}
    for name, shape in READ.items():
        if name not in fields:
            continue
        values = fields[name]
        if values.size != count * int(np.prod(shape)) or values.dtype.kind not in "fiu":
            wanted = ", ".join(map(str, (count, *shape)))
            raise UserError(f"{where}: '{name}' has the shape {values.shape}; accepted: numbers ({wanted})")
        kind = values.dtype if values.dtype == np.float64 else np.float32
        found[name] = values.reshape(count, *shape).astype(np.int64 if name == "id" else kind)
    return found


def joined_components(table: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Columns of numbers as fields: the numbered components of a vector or tensor together."""
    fields: dict[str, np.ndarray] = {}
    for name, values in table.items():
        stem, _, digits = name.rpartition("_")
        if not (stem and digits.isdigit()):
            fields[name] = values
        elif digits == "0":
            parts = [values]
            while f"{stem}_{len(parts)}" in table:
                parts.append(table[f"{stem}_{len(parts)}"])
            fields[stem] = np.stack(parts, axis=1)
    return fields


def name_unread(path: Path, names: Sequence[str], read: Collection[str] = READ) -> None:
    """One line for fields of a file that are not among those that are read."""
    others = [name for name in dict.fromkeys(names) if name not in read]
    if others:
        shown = ", ".join(name[:60] if name.isprintable() else ascii(name)[:60] for name in others[:8])
        more = f" and {len(others) - 8} more" if len(others) > 8 else ""
        log.warning("%s: not read: %s%s", path, shown, more)


def _places(frame: Frame, first: Frame, number: int, where: str) -> np.ndarray:
    """Where the particles of a frame are among those of the first one."""
    count = len(first.position)
    if not count:
        raise UserError(f"{where}: holds no particle in its first frame")
    if "id" not in first.fields or "id" not in frame.fields:
        if len(frame.position) != count:
            raise UserError(
                f"{where}: frame {number} has {len(frame.position)} particles, the first one {count}; accepted: the "
                "same particles in all frames, or a field 'id'"
            )
        return np.arange(count)
    known, ids = first.fields["id"], frame.fields["id"]
    order = np.argsort(known, kind="stable")
    place = order[np.minimum(np.searchsorted(known[order], ids), count - 1)]
    if len(np.unique(known)) < count or len(np.unique(ids)) < len(ids) or np.any(known[place] != ids):
        raise UserError(f"{where}: frame {number} has an id twice, or one that is not in the first frame")
    return place


def _gathered(values: Sequence[np.ndarray], places: Sequence[np.ndarray]) -> np.ndarray:
    """Values of the frames in the order of the first one, NaN where there is none."""
    kind = np.float64 if all(one.dtype == np.float64 for one in values) else np.float32
    found = np.full((len(values), *values[0].shape), np.nan, kind)
    for frame, (one, place) in enumerate(zip(values, places, strict=True)):
        found[frame, place] = one
    return found


def _equal_volumes(position: np.ndarray, where: str) -> np.ndarray:
    """Cubes as wide as the particles are apart, of a file without volumes: on a motion only their ratios act."""
    if len(position) < FEWEST_PARTICLES:
        raise UserError(f"{where}: the field 'volume' is missing; accepted: the initial volume of each particle [m^3]")
    nearest = np.asarray(KDTree(position).query(position, k=2)[0])[:, 1]
    edge = float(np.median(nearest))
    log.warning(
        "%s: holds no volumes; each particle is given the cube of the median distance to its nearest, (%.3g m)^3",
        where,
        edge,
    )
    return np.full(len(position), edge**3, position.dtype)


def _common_parameters(frame: Frame, where: str) -> dict[str, float]:
    found = {}
    for name in PARAMETERS:
        if name in frame.fields:
            values = frame.fields[name]
            if np.any(values != values[0]):
                raise UserError(f"{where}: '{name}' differs between the particles; accepted: one value for all")
            found[name] = float(values[0])
    return found


def _check(where: str, **arrays: np.ndarray | None) -> None:
    for name, values in arrays.items():
        start = values[0] if name == "position" and values is not None else values
        if start is not None and not np.isfinite(start).all():
            raise UserError(f"{where}: '{name}' holds numbers that are not finite")
        if name == "position" and values is not None and np.isinf(values).any():
            raise UserError(f"{where}: '{name}' holds numbers that are not finite")
        if name in ("volume", "density") and values is not None and np.any(values <= 0.0):
            raise UserError(f"{where}: '{name}' is not positive everywhere")
