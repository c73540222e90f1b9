"""Trajectory files: the only HDF5 reader and writer. docs/conventions.md shows the file as a tree.

The reader runs no code from a file and follows no link out of it; whatever is wrong with a file is a UserError of
one line that names the file, the scene and the fault. The writer replaces a file whole or not at all.
"""

import logging
from collections.abc import Sequence
from pathlib import Path

import h5py

from pcnclaws.atomic import replaced_file
from pcnclaws.data.guarded_hdf5 import GuardedGroup, check_heaps, one_line_faults
from pcnclaws.data.plain_records import plain_record, record_from
from pcnclaws.data.reading_apart import read_apart
from pcnclaws.data.scene_groups import checked_name, read_scene, write_scene
from pcnclaws.data.scene_settings import VERSIONS, version_of
from pcnclaws.errors import UserError, unknown_name
from pcnclaws.simulation.records import Keyframes, SceneRecord

log = logging.getLogger(__name__)

__all__ = ["Keyframes", "SceneRecord", "read_scenes", "scene_names", "write_scenes"]

FORMAT = "pcnclaws.trajectories"
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
            write_scene(scenes.create_group(checked_name(record.name)), record, version)
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
        records = [read_scene(scenes, name, version, with_keyframes) for name in names or known]
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
