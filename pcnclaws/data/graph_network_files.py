"""Trajectories of the public data sets of graph network simulators (GNS): an .npz of pickled arrays, and metadata.json.

Source: Sanchez-Gonzalez et al. 2020, "Learning to simulate complex physics with graph networks", whose data sets are
TFRecords, in the .npz form of https://github.com/geoelements/gns: an array of objects for each trajectory, which holds
positions (frames, particles, 3) and the kind of each particle, or one array `gns_data` of all of them.
"""

import json
import logging
import zipfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from pcnclaws.data.frame_records import Frame, record_of
from pcnclaws.data.guarded_npz import MAXIMUM_BYTES
from pcnclaws.data.pickled_arrays import pickled_arrays
from pcnclaws.data.room import require_room
from pcnclaws.data.scene_notes import LONGEST, SETTINGS
from pcnclaws.errors import UserError
from pcnclaws.laws.parameters import PARAMETERS
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.simulation.records import SceneRecord

log = logging.getLogger(__name__)

METADATA = "metadata.json"
ALL = "gns_data"


def is_graph_network_file(path: Path) -> bool:
    """Whether an .npz holds arrays of objects alone, as these data sets do; False for whatever is damaged."""
    try:
        with zipfile.ZipFile(path) as archive:
            kinds = [_header(archive, name)[1] for name in archive.namelist()]
    except Exception:  # whoever reads it next says what is wrong
        return False
    return bool(kinds) and all(kind.hasobject for kind in kinds)


def read_graph_network_file(path: Path, material: str) -> list[SceneRecord]:
    """The trajectories of a data set as scenes, by their names in the file.

    The time between frames, `dt` [s], is in metadata.json in the same folder, which may hold `bounds` (3, 2) [m],
    between which the particles stay, and what else a scene needs by its name: material, physical parameters, settings.
    Kinds of particles and values of materials are not read.
    raises  UserError, one line, for whatever is wrong with the files
    """
    notes = _metadata(path.parent / METADATA)
    step = notes.pop("dt")
    records = []
    for name, (position, *others) in _trajectories(path):
        where = f"{path}: '{name}'"
        if not isinstance(position, np.ndarray) or position.ndim != 3 or position.dtype.kind != "f":
            raise UserError(f"{where} holds no positions; accepted: numbers (frames, particles, 3)")
        if position.shape[2] != 3:
            raise UserError(f"{where} is of {position.shape[2]} dimensions; accepted: 3")
        if not position.shape[0] or not position.shape[1]:
            raise UserError(f"{where} holds no frame of particles")
        kind = np.float64 if position.dtype == np.float64 else np.float32
        frames = [Frame(step * k, one.astype(kind), {}, notes) for k, one in enumerate(position)]
        records.append(replace(record_of(frames, path, name, material), name=name))
        if len(others) > 1:
            log.warning("%s: not read: material properties", where)
    return records


def _trajectories(path: Path) -> Iterator[tuple[str, list[Any]]]:
    for name, content in _members(path):
        each = content if name == ALL else [content]
        for number, one in enumerate(each):
            if not isinstance(one, list) or len(one) < 2:
                raise UserError(f"{path}: '{name}' is no trajectory; accepted: positions, and kinds of particles")
            yield f"{name}_{number}" if name == ALL else name, one


def _members(path: Path) -> Iterator[tuple[str, list[Any]]]:
    try:
        with zipfile.ZipFile(path) as archive:
            size = sum(member.file_size for member in archive.infolist())
            if size > MAXIMUM_BYTES:
                raise UserError(f"{path}: claims more than {MAXIMUM_BYTES / 1024**3:g} GiB of arrays")
            require_room(2 * size, str(path))
            for name in archive.namelist():
                with cast(zipfile.ZipExtFile, archive.open(name)) as file:
                    np.lib.format.read_magic(file)
                    np.lib.format.read_array_header_1_0(file)
                    content = pickled_arrays(file)
                if not isinstance(content, list):
                    raise ValueError(f"'{name[:60]}' is no list of arrays")
                yield name.removesuffix(".npy"), content
    except UserError:
        raise
    except Exception as error:  # zip, zlib and pickles raise whatever a damaged file makes them meet
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise UserError(f"{path}: not an .npz file of trajectories, or damaged ({reason})") from error


def _header(archive: zipfile.ZipFile, name: str) -> tuple[tuple[int, ...], np.dtype]:
    with cast(zipfile.ZipExtFile, archive.open(name)) as file:
        np.lib.format.read_magic(file)
        shape, _, kind = np.lib.format.read_array_header_1_0(file)
    return shape, kind


def _metadata(path: Path) -> dict[str, Any]:
    """dt, and notes of the scenes."""
    try:
        text = path.read_text(encoding="utf-8") if path.stat().st_size < LONGEST else ""
        found = json.loads(text)
    except (OSError, ValueError, RecursionError) as error:
        raise UserError(f"{path}: needed for the time between frames, and missing or damaged; accepted: a JSON "
                        "file with 'dt' [s]") from error  # fmt: skip
    step = found.get("dt") if isinstance(found, dict) else None
    if isinstance(step, bool) or not isinstance(step, int | float) or not 0.0 < step < 1e6:
        raise UserError(f"{path}: its 'dt' is not a time; accepted: seconds above 0")
    notes = {name: found[name] for name in ("material", *SETTINGS, *PARAMETERS) if name in found}
    if "bounds" in found and "domain" not in notes:
        notes["domain"] = _domain(found["bounds"], notes.get("wall_distance", SimulationSettings().wall_distance), path)
    return notes | {"dt": float(step)}


def _domain(bounds: Any, wall_distance: Any, path: Path) -> list[list[float]]:
    """The box whose walls are at the bounds of the particles."""
    try:
        low, high = np.array(bounds, dtype=np.float64).T
        distance = float(wall_distance)
        return np.round([low - distance, high + distance], 9).tolist()
    except (TypeError, ValueError) as error:
        raise UserError(f"{path}: its 'bounds' are not lengths; accepted: [[x0, x1], [y0, y1], [z0, z1]]") from error
