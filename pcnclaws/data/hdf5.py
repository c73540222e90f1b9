"""Trajectory files: the only HDF5 reader and writer. docs/conventions.md shows the file as a tree.

The reader runs no code from a file and follows no link out of it; whatever is wrong with a file is a UserError of
one line that names the file, the scene and the fault. The writer replaces a file whole or not at all.
"""

import logging
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np

from pcnclaws.atomic import replaced_file
from pcnclaws.data.guarded_hdf5 import GuardedGroup, check_heaps, one_line_faults
from pcnclaws.data.plain_records import plain_record, record_from
from pcnclaws.data.reading_apart import read_apart
from pcnclaws.data.scene_settings import VERSIONS, read_settings, version_of, write_settings
from pcnclaws.errors import UserError, unknown_name
from pcnclaws.laws.parameters import PARAMETERS, validate_parameters
from pcnclaws.simulation.placement import require_volume
from pcnclaws.simulation.records import Keyframes, SceneRecord

log = logging.getLogger(__name__)

__all__ = ["Keyframes", "SceneRecord", "read_scenes", "scene_names", "write_scenes"]

FORMAT = "pcnclaws.trajectories"
# Bytes of a compressed chunk: small enough to read a few frames, large enough to compress.
CHUNK_BYTES = 2**19
LONGEST_TIME = 1e9
# Files that this process has written, as they were then.
_WRITTEN: set[tuple[int, ...]] = set()
# At most so many names of what a file holds beside a trajectory are listed.
LISTED = 8


def write_scenes(path: str | Path, records: Sequence[SceneRecord]) -> None:
    """Writes a trajectory file, complete or not at all; folders above it are made.

    The file lies in memory until it is complete, compressed, beside the records themselves.
    raises  UserError when the path cannot be written, CannotWrite when there is no room, ValueError when two scenes
            have the same name
    """
    names = [record.name for record in records]
    if len(set(names)) != len(names) or not names:
        raise ValueError(f"a trajectory file needs one or more scenes with different names, not {names}")
    # in memory: on a full disk the library crashes when the process ends
    with replaced_file(path) as part, h5py.File(part, "w") as file:
        file.attrs["format"] = FORMAT
        version = max(_version_of(record) for record in records)
        file.attrs["version"] = version
        scenes = file.create_group("scenes")
        for record in records:
            _write_scene(scenes.create_group(_checked_name(record.name)), record, version)
    _WRITTEN.add(_identity(Path(path)))


def read_scenes(path: str | Path, names: Sequence[str] | None = None, with_keyframes: bool = True) -> list[SceneRecord]:
    """The scenes of a trajectory file, sorted by name, or those of the given names in their order.

    What the file holds beside them is named in one line. A file that this process has not written is read in a forked
    child: there are damaged files on which the HDF5 library crashes, at once or later, or from which it never returns.
    raises  UserError, one line, for whatever is wrong with the file
    """
    path = Path(path)
    if _is_own(path):
        return _read_scenes(path, names, with_keyframes)
    found = read_apart(path, lambda: [plain_record(one) for one in _read_scenes(path, names, with_keyframes)])
    return [record_from(plain) for plain in found]


def scene_names(path: str | Path) -> list[str]:
    """Names of the scenes of a trajectory file, sorted."""
    path = Path(path)
    return _scene_names(path) if _is_own(path) else read_apart(path, lambda: _scene_names(path))


def _read_scenes(path: str | Path, names: Sequence[str] | None, with_keyframes: bool) -> list[SceneRecord]:
    with one_line_faults(str(path)), _opened(path) as file:
        root = GuardedGroup(file, str(path))
        scenes, version = _scenes_of(root)
        known = scenes.names()
        for name in names or ():
            if name not in known:
                raise unknown_name("scene", name, known)
        records = [_read_scene(scenes, name, version, with_keyframes) for name in names or known]
        _name_unread(root, names or known)
    return records


def _scene_names(path: str | Path) -> list[str]:
    with one_line_faults(str(path)), _opened(path) as file:
        return _scenes_of(GuardedGroup(file, str(path)))[0].names()


def _is_own(path: Path) -> bool:
    """Whether there is nothing to fear: this process has written the file, or there is none."""
    return not path.is_file() or _identity(path) in _WRITTEN


def _identity(path: Path) -> tuple[int, ...]:
    """Of a file and its content."""
    stat = path.stat()
    return stat.st_dev, stat.st_ino, stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns


def _version_of(record: SceneRecord) -> int:
    """The first version of the format that can hold the scene."""
    remembers = record.keyframes is not None and record.keyframes.internal
    return 2 if remembers else version_of(record.settings)


def _opened(path: str | Path) -> h5py.File:
    path = Path(path)
    if not path.exists():
        raise UserError(f"{path}: no such file")
    if not path.is_file():
        raise UserError(f"{path}: not a file; accepted: a trajectory file (HDF5)")
    if path.stat().st_size == 0:
        raise UserError(f"{path}: the file is empty; accepted: a trajectory file (HDF5)")
    if not h5py.is_hdf5(path):
        raise UserError(f"{path}: not an HDF5 file, or damaged; accepted: a trajectory file (HDF5)")
    check_heaps(path)
    return h5py.File(path, "r")


def _scenes_of(root: GuardedGroup) -> tuple[GuardedGroup, int]:
    """The scenes, and the version of the format."""
    found = root.text("format") if root.has_attribute("format") else ""
    if found != FORMAT:
        raise root.fault(f"not a trajectory file (@format='{found}'); accepted: @format='{FORMAT}'")
    if (version := root.whole_number("version")) not in VERSIONS:
        raise root.fault(f"@version={version} is not known; accepted: {', '.join(map(str, VERSIONS))}")
    scenes = root.group("scenes")
    if not scenes.names():
        raise root.fault("holds no scene")
    return scenes, version


def _name_unread(root: GuardedGroup, scenes: Sequence[str]) -> None:
    """One line for all attributes and datasets of the file that are not part of a trajectory."""
    paths = root.unread()
    for scene in scenes:
        paths = [path.removeprefix(f"scenes/{scene}/") for path in paths]
    names = [name if name.isprintable() else ascii(name) for name in dict.fromkeys(paths)]
    if names:
        more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
        log.warning("%s: not read: %s%s", root.where, ", ".join(name[:60] for name in names[:LISTED]), more)


def _read_scene(scenes: GuardedGroup, name: str, version: int, with_keyframes: bool) -> SceneRecord:
    path = scenes.where
    where = f"{path}: scene '{name}'" if name.isprintable() else f"{path}: scene {name!a}"
    with one_line_faults(where):
        group = scenes.group(name, where)
        _checked_name(name)
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


def _checked_name(name: str) -> str:
    if not name.isprintable() or not 0 < len(name) <= 100 or "/" in name or name in (".", ".."):
        raise UserError(f"the scene name {name!a} is not accepted; accepted: up to 100 printable characters without /")
    return name


def _write_scene(group: h5py.Group, record: SceneRecord, version: int) -> None:
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
