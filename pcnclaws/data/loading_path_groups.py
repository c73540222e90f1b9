"""Loading paths in HDF5 files: a group a path, with F (n, 3, 3), stress (n, 3, 3) and @stress_type.

<study>/<path>/F, stress     the study is the specimen; a file may also hold its paths at the top
<study>/<path>/@stress_type  PK1 or cauchy
<study>/<path>/@unit         of the stress: Pa, kPa, MPa or GPa
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

import h5py
import numpy as np

from pcnclaws.data.guarded_hdf5 import GuardedGroup, check_heaps, one_line_faults
from pcnclaws.data.loading_paths import STRESSES, LoadingPath, check_path, matching, unit_factor
from pcnclaws.data.reading_apart import read_apart
from pcnclaws.errors import UserError, unknown_name

MOST_PATHS = 1000
# Stresses and changes of stretch below this share of the largest count as none.
NOTHING = 1e-9


def read_groups(file: Path, units: Sequence[tuple[str, str]]) -> list[LoadingPath]:
    """The loading paths of an HDF5 file.

    A component of the stress that is zero throughout was not measured; a side that has none of its own and whose
    stretch changes is free.
    units   as of read_loading_paths
    raises  UserError
    """
    paths = read_apart(file, lambda: [path._asdict() for path in _read(file, units)])
    if not paths:
        raise UserError(f"{file}: holds no loading path; accepted: groups with F, stress and @stress_type")
    return [LoadingPath(**path) for path in paths]


def _read(file: Path, units: Sequence[tuple[str, str]]) -> list[LoadingPath]:
    with one_line_faults(str(file)):
        check_heaps(file)
        with h5py.File(file, "r") as opened:
            return [_path(*found, units) for found in _groups(GuardedGroup(opened, str(file)))]


def _groups(top: GuardedGroup) -> Iterator[tuple[str, str, GuardedGroup]]:
    """Name, specimen and group of each path."""
    for name in top.names()[:MOST_PATHS]:
        group = top.group(name, f"{top.where}: {name}")
        if "F" in group:
            yield name, "specimen", group
            continue
        for below in group.names()[:MOST_PATHS]:
            yield f"{name}/{below}", name, group.group(below, f"{top.where}: {name}/{below}")


def _path(name: str, specimen: str, group: GuardedGroup, units: Sequence[tuple[str, str]]) -> LoadingPath:
    deformation = group.array("F", (None, 3, 3)).astype(np.float64)
    stress = group.array("stress", (len(deformation), 3, 3)).astype(np.float64)
    kind = group.text("stress_type")
    if kind not in STRESSES:
        raise unknown_name(f"{group.where}: stress_type", kind, STRESSES)
    unit = group.text("unit") if group.has_attribute("unit") else matching(name, units)
    if unit is None:
        raise group.fault("no @unit of the stress; accepted: Pa, kPa, MPa or GPa there, or in stress.units")
    if not np.isfinite(stress).all():
        raise group.fault("'stress' holds numbers that are not finite; accepted: finite numbers")
    size = np.abs(stress).max((0, 1, 2))
    unmeasured = np.abs(stress).max(0) <= NOTHING * size
    changes = np.ptp(np.diagonal(deformation, axis1=1, axis2=2), axis=0) > NOTHING
    free = np.array([bool(changes[k] and unmeasured[k].all() and unmeasured[:, k].all()) for k in range(3)])
    stress = np.where(unmeasured, np.nan, stress * unit_factor(unit, group.where))
    return check_path(LoadingPath(name, specimen, deformation, free, stress=stress, is_cauchy=kind == "cauchy"))
