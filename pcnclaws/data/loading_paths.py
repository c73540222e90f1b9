"""Loading paths: measured stress of a specimen over its deformation, for laws that are trained on stress."""

from collections.abc import Sequence
from fnmatch import fnmatchcase
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from pcnclaws.errors import UserError, unknown_name

UNITS = {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9}
STRESSES = ("PK1", "cauchy")
# How far det F may be from 1 in data of an incompressible body.
INCOMPRESSIBLE = 2e-3


class LoadingPath(NamedTuple):
    """Measured stress along a loading path.

    name         file or group in the file
    specimen     that it is of: paths of one specimen share their physical parameters
    deformation  deformation gradient F [-]; free sides hold what was recorded or assumed there, NaN where nothing was
    free         sides that carry no stress and follow from the law
    stress       [Pa], NaN where it was not measured
    is_cauchy    whether it is the Cauchy stress; else the first Piola-Kirchhoff stress
    reference    side whose stress the measured one is the difference to; None: the stress itself
    weight       of its squared relative error in a training
    """

    name: str
    specimen: str
    deformation: Float[np.ndarray, "points 3 3"]
    free: Bool[np.ndarray, " 3"]
    stress: Float[np.ndarray, "points 3 3"]
    is_cauchy: bool
    reference: int | None = None
    weight: float = 1.0

    @property
    def is_incompressible(self) -> bool:
        """Whether all of F was recorded, with det F = 1."""
        if not np.isfinite(self.deformation).all():
            return False
        return bool((np.abs(np.linalg.det(self.deformation) - 1.0) < INCOMPRESSIBLE).all())

    @property
    def measured(self) -> list[tuple[int, int]]:
        """The components of the stress that were measured."""
        return [(int(i), int(j)) for i, j in np.argwhere(np.isfinite(self.stress).any(0))]


def unit_factor(unit: str, where: str) -> float:
    """Pa of a unit of stress."""
    if unit not in UNITS:
        raise unknown_name(f"{where}: unit of stress", unit, UNITS)
    return UNITS[unit]


def matching(name: str, pairs: Sequence[tuple[str, str]]) -> str | None:
    """What the first pattern (* for any text) that fits a name stands beside; None where none does."""
    return next((value for pattern, value in pairs if fnmatchcase(name, pattern)), None)


def check_path(path: LoadingPath) -> LoadingPath:
    """The path, whose numbers and free sides can be used; UserError otherwise."""
    known = path.deformation.copy()
    sides = np.flatnonzero(path.free)
    for side in sides:
        known[:, side, side] = 1.0
        others = [k for k in range(3) if k != side]
        if np.any(known[:, side, others]) or np.any(known[:, others, side]):
            raise UserError(f"{path.name}: side {side + 1} is free and sheared; accepted: a free side without shear")
    if not np.isfinite(known).all():
        raise UserError(f"{path.name}: F holds numbers that are not finite; accepted: finite numbers")
    bad = np.flatnonzero(np.linalg.det(known) <= 0.0)
    if len(bad):
        raise UserError(f"{path.name}: point {int(bad[0])} has det F <= 0; accepted: above 0")
    for i, j in path.measured:
        if i in sides or j in sides:
            raise UserError(f"{path.name}: side {max(i, j) + 1} is free and its stress is given; accepted: one of them")
    if not path.measured or not np.nanmax(np.abs(path.stress)) > 0.0:
        raise UserError(f"{path.name}: holds no stress but zeros; accepted: one component or more")
    return path
