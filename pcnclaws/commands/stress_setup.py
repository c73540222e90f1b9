"""Loading paths of a training on measured stress, from the options data.stress and stress.*."""

from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np

from pcnclaws.commands.typed_configs import TrainConfig
from pcnclaws.commands.typed_groups import MeasuredStress
from pcnclaws.data.loading_path_files import read_loading_paths
from pcnclaws.data.loading_paths import LoadingPath, matching
from pcnclaws.errors import UserError

INCOMPRESSIBLE = 0.5
Pairs = list[tuple[str, str]]


@dataclass(frozen=True)
class StressData:
    """What a law is trained on.

    specimens       their names
    poissons_ratio  of all of them, 0.5 for incompressible bodies
    notes           for the user, one line each
    """

    paths: Sequence[LoadingPath]
    specimens: Sequence[str]
    poissons_ratio: float
    notes: tuple[str, ...]

    @property
    def is_incompressible(self) -> bool:
        """Whether the pressure is eliminated, not computed."""
        return self.poissons_ratio == INCOMPRESSIBLE


def stress_data(config: TrainConfig) -> StressData:
    """The loading paths of `data.stress`, with what `stress.*` says of them.

    raises  UserError
    """
    options, named = config.stress, config.data.stress
    files = [named] if isinstance(named, str) else named
    if not isinstance(files, list) or not files or not all(isinstance(file, str) for file in files):
        raise UserError(
            f"data.stress={named} is not accepted; accepted: the path of a CSV or HDF5 file, or a list of them"
        )
    read = read_loading_paths([Path(file) for file in files], _pairs(options.units, "units"))
    paths = [_described(path, options) for path in read]
    _require_used(options, [path.name for path in paths])
    if not any(path.weight > 0.0 for path in paths):
        raise UserError("stress.leave_out leaves no path to train on; accepted: patterns that leave one or more")
    ratio, notes = _poissons_ratio(options.poissons_ratio, paths)
    left_out = [path.name for path in paths if path.weight == 0.0]
    specimens = list(dict.fromkeys(path.specimen for path in paths))
    for specimen in specimens:
        if all(path.weight == 0.0 for path in paths if path.specimen == specimen):
            raise UserError(f"stress.leave_out leaves no path of specimen '{specimen}'; accepted: one or more")
    shown = f"{len(paths) - len(left_out)} loading paths of {len(specimens)} specimens to train on"
    return StressData(paths, specimens, ratio, (f"{shown}, {len(left_out)} left out", *notes))


def _described(path: LoadingPath, options: MeasuredStress) -> LoadingPath:
    """The path with what stress.* says of it."""
    specimen = matching(path.name, _pairs(options.specimens, "specimens")) or path.specimen
    reference = matching(path.name, _pairs(options.reference, "reference"))
    if reference not in (None, "1", "2", "3"):
        raise UserError(f"stress.reference: side '{reference}' is not known; accepted: 1, 2, 3")
    weight = _weight(matching(path.name, _pairs(options.weights, "weights")))
    left_out = any(fnmatchcase(path.name, pattern) for pattern in _texts(options.leave_out, "leave_out"))
    return path._replace(
        specimen=specimen,
        reference=None if reference is None else int(reference) - 1,
        weight=0.0 if left_out else weight,
    )


def _weight(text: str | None) -> float:
    try:
        weight = 1.0 if text is None else float(text)
    except ValueError:
        weight = -1.0
    if not 0.0 < weight < np.inf:
        raise UserError(f"stress.weights: factor '{text}' is not accepted; accepted: a finite number above 0")
    return weight


def _poissons_ratio(given: Any, paths: Sequence[LoadingPath]) -> tuple[float, tuple[str, ...]]:
    if given is None and all(path.is_incompressible for path in paths):
        return INCOMPRESSIBLE, ("det F = 1 at every point: the bodies are taken as incompressible",)
    if given is None:
        note = "free sides were not measured: they follow from Poisson's ratio 0, or from stress.poissons_ratio"
        return 0.0, (note,)
    if isinstance(given, bool) or not isinstance(given, (int, float)) or not 0.0 <= given <= INCOMPRESSIBLE:
        raise UserError(f"stress.poissons_ratio={given} is not accepted; accepted: null, or a number from 0 to 0.5")
    return float(given), ()


def _pairs(given: Any, option: str) -> Pairs:
    """The option's 'PATTERN: VALUE' as pairs."""
    pairs = [text.rpartition(":") for text in _texts(given, option)]
    for pattern, _, value in pairs:
        if not pattern.strip() or not value.strip():
            raise UserError(f"stress.{option}={given} is not accepted; accepted: a list of 'PATTERN: VALUE'")
    return [(pattern.strip(), value.strip()) for pattern, _, value in pairs]


def _texts(given: Any, option: str) -> list[str]:
    if given is None:
        return []
    if not isinstance(given, list) or not all(isinstance(text, str) for text in given):
        raise UserError(f"stress.{option}={given} is not accepted; accepted: a list of texts")
    return given


def _require_used(options: MeasuredStress, names: Sequence[str]) -> None:
    """Refuses patterns that fit no path."""
    for option in ("specimens", "reference", "weights"):
        for pattern, _ in _pairs(getattr(options, option), option):
            _require_fit(pattern, option, names)
    for pattern in _texts(options.leave_out, "leave_out"):
        _require_fit(pattern, "leave_out", names)


def _require_fit(pattern: str, option: str, names: Sequence[str]) -> None:
    if not any(fnmatchcase(name, pattern) for name in names):
        raise UserError(f"stress.{option}: no path is called '{pattern}'; accepted: {', '.join(names[:8])} ...")
