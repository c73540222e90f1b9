"""One scene of a trajectory file: its group, checked and read, and written."""

import logging
from collections.abc import Sequence
from dataclasses import replace

import h5py
import numpy as np

from pcnclaws.data.guarded_hdf5 import GuardedGroup, one_line_faults
from pcnclaws.data.scene_settings import read_settings, write_settings
from pcnclaws.errors import UserError
from pcnclaws.laws.parameters import PARAMETERS, validate_parameters
from pcnclaws.simulation.placement import require_volume
from pcnclaws.simulation.records import Keyframes, SceneRecord

log = logging.getLogger(__name__)

# Bytes of a compressed chunk: small enough to read a few frames, large enough to compress.
CHUNK_BYTES = 2**19
LONGEST_TIME = 1e9


def read_scene(scenes: GuardedGroup, name: str, version: int, with_keyframes: bool) -> SceneRecord:
    """A scene, checked; without its keyframes where they are not asked for."""
    path = scenes.where
    where = f"{path}: scene '{name}'" if name.isprintable() else f"{path}: scene {name!a}"
    with one_line_faults(where):
        group = scenes.group(name, where)
        checked_name(name)
        settings, parameters = read_settings(group, version), _parameters(group)
        time = group.array("time", (None,)).astype(np.float64)
        position = _numbers(group, "position", (len(time), None, 3))
        particles = position.shape[1]
        volume = _numbers(group, "volume", (particles,))
        start = _numbers(group, "initial_velocity", (particles, 3)) if "initial_velocity" in group else None
        velocity = _numbers(group, "velocity", position.shape) if "velocity" in group else None
        affine = _numbers(group, "initial_affine", (particles, 3, 3)) if "initial_affine" in group else None
        density = _numbers(group, "density", (particles,)) if "density" in group else None
        colliders = len(settings.colliders)
        impulses = _numbers(group, "impulses", (len(time), colliders, 3)) if "impulses" in group else None
        loaded_at = _numbers(group, "loaded_at", (particles, 3)) if settings.loads and "loaded_at" in group else None
        record = SceneRecord(
            name,
            group.text("material"),
            settings,
            parameters,
            time=time,
            position=position,
            volume=volume,
            initial_velocity=start,
            velocity=velocity,
            source=path,
            initial_affine=affine,
            density=density,
            impulses=impulses,
            loaded_at=loaded_at,
        )
        _check_values(group, record)
        require_volume(volume, settings, group.where)
        keyframes = _keyframes(group, record, version) if "keyframes" in group and with_keyframes else None
        return replace(record, keyframes=keyframes)


def _parameters(group: GuardedGroup) -> dict[str, float]:
    parameters = {name: group.number(name) for name in PARAMETERS if group.has_attribute(name)}
    validate_parameters(parameters, list(parameters))
    return parameters


def _numbers(group: GuardedGroup, name: str, shape: Sequence[int | None]) -> np.ndarray:
    """A dataset in the precision of the file: double where it is, else single.

    A number too large for single precision becomes infinite and is refused by the checks: it may be run in it.
    """
    values = group.array(name, shape)
    with np.errstate(over="ignore", under="ignore"):
        single = values.astype(np.float32)
    return np.where(np.isinf(single), single, values) if values.dtype == np.float64 else single


def _check_values(group: GuardedGroup, record: SceneRecord) -> None:
    time, position, volume, density = record.time, record.position, record.volume, record.density
    if not np.all(np.abs(time) < LONGEST_TIME) or np.any(np.diff(time) <= 0.0):
        raise group.fault(f"'time' is not increasing, or not below {LONGEST_TIME:g} s")
    for name, values in (
        ("position", position[0]),
        ("volume", volume),
        ("initial_velocity", record.initial_velocity),
        ("velocity", record.velocity),
        ("initial_affine", record.initial_affine),
        ("density", density),
        ("loaded_at", record.loaded_at),
    ):
        if values is not None and not np.isfinite(values).all():
            first = " in the first frame" if name == "position" else ""
            raise group.fault(f"'{name}' holds numbers that are not finite{first}")
    unknown = np.isnan(position)
    if np.isinf(position).any() or np.any(unknown.any(2) != unknown.all(2)):
        raise group.fault(
            "'position' holds numbers that are not finite; accepted: NaN in all three coordinates of a "
            "particle that was not observed"
        )
    for name, values in (("volume", volume), ("density", density)):
        if values is not None and np.any(values.astype(np.float32) <= 0.0):
            raise group.fault(f"'{name}' is not positive everywhere")


def _keyframes(scene: GuardedGroup, record: SceneRecord, version: int) -> Keyframes | None:
    """The keyframes whose state is complete: a keyframe without recorded positions or velocities starts nothing."""
    group = scene.group("keyframes")
    step = group.array("step", (None,), "iu").astype(np.int64)
    particles = record.position.shape[1]
    affine, deformation = (_numbers(group, name, (len(step), particles, 3, 3)) for name in ("affine", "deformation"))
    if step[0] < 0 or np.any(np.diff(step) < 1):
        raise scene.fault("'keyframes/step' is not increasing from 0")
    if not np.isfinite(affine).all() or not np.isfinite(deformation).all():
        raise scene.fault("'keyframes' hold numbers that are not finite")
    if np.any(np.linalg.det(deformation.astype(np.float64)) <= 0.0):
        raise scene.fault("'keyframes/deformation' is not a deformation gradient everywhere (det F <= 0)")
    position, velocity = (_at_keyframes(group, name, step, record) for name in ("position", "velocity"))
    complete = np.isfinite(position).all((1, 2)) & np.isfinite(velocity).all((1, 2))
    if not complete.all():
        log.warning(
            "%s: %d of %d keyframes have no recorded position or velocity and are not used",
            record.label,
            np.count_nonzero(~complete),
            len(step),
        )
    internal = _internal(group, len(step), particles) if version > 1 else {}
    found = Keyframes(step, position, velocity, affine, deformation=deformation, internal=internal)
    return found.at(np.flatnonzero(complete)) if complete.any() else None


def _internal(group: GuardedGroup, keyframes: int, particles: int) -> dict[str, np.ndarray]:
    """Internal variables at the keyframes by name, each (keyframes, particles)."""
    if "internal" not in group:
        return {}
    variables = group.group("internal")
    found = {name: _numbers(variables, name, (keyframes, particles)) for name in variables.names()}
    for name, values in found.items():
        if not np.isfinite(values).all():
            raise variables.fault(f"'keyframes/internal/{name}' holds numbers that are not finite")
    return found


def _at_keyframes(group: GuardedGroup, name: str, step: np.ndarray, record: SceneRecord) -> np.ndarray:
    """Position or velocity at the keyframes, from the group itself or from the frames; NaN where there is none."""
    shape = (len(step), record.position.shape[1], 3)
    if name in group:
        return _numbers(group, name, shape)
    values = np.full(shape, np.nan, record.position.dtype)
    if name == "velocity" and record.initial_velocity is not None:
        values[step == 0] = record.initial_velocity
    frames = record.position if name == "position" else record.velocity
    if frames is not None:
        _, of_keyframes, of_frames = np.intersect1d(step, record.frame_steps(), return_indices=True)
        values[of_keyframes] = frames[of_frames]
    return values


def checked_name(name: str) -> str:
    """The name of a scene, fit for a group of a file."""
    if not name.isprintable() or not 0 < len(name) <= 100 or "/" in name or name in (".", ".."):
        raise UserError(f"the scene name {name!a} is not accepted; accepted: up to 100 printable characters without /")
    return name


def write_scene(group: h5py.Group, record: SceneRecord, version: int) -> None:
    """Writes a scene into its group, in a version of the format that can hold it."""
    group.attrs["material"] = record.material
    write_settings(group, record.settings, version)
    for name, value in record.parameters.items():
        group.attrs[name] = float(value)
    _write_array(group, "time", record.time.astype(np.float64))
    for name in (
        "position",
        "volume",
        "initial_velocity",
        "initial_affine",
        "velocity",
        "density",
        "impulses",
        "loaded_at",
    ):
        values = getattr(record, name)
        if values is not None:
            _write_array(group, name, _as_recorded(values))
    if record.keyframes is not None:
        keyframes = group.create_group("keyframes")
        arrays = dict(vars(record.keyframes))
        internal = arrays.pop("internal")
        for name, values in arrays.items():
            _write_array(keyframes, name, values if name == "step" else _as_recorded(values))
        for name, values in internal.items():
            _write_array(keyframes.require_group("internal"), name, _as_recorded(values))


def _as_recorded(values: np.ndarray) -> np.ndarray:
    """Double precision stays; everything else is single."""
    return values if values.dtype == np.float64 else values.astype(np.float32)


def _write_array(group: h5py.Group, name: str, values: np.ndarray) -> None:
    """Compressed, and with checksums: a damaged byte is found when the array is read."""
    frame = max(values[0].nbytes, 1)
    chunks = (max(1, min(len(values), CHUNK_BYTES // frame)), *values.shape[1:])
    group.create_dataset(
        name, data=values, chunks=chunks, compression="gzip", compression_opts=4, shuffle=True, fletcher32=True
    )
