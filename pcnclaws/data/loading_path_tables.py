"""Loading paths in CSV files: a path a file, a point a line, units in the names of the columns."""

import csv
import math
import re
from pathlib import Path

import numpy as np

from pcnclaws.data.csv_files import opened_table
from pcnclaws.data.loading_paths import STRESSES, LoadingPath, check_path, unit_factor
from pcnclaws.errors import UserError

# lambda, stretch, lambda_2, F12, gamma; P_MPa, P11_kPa, sigma_12_Pa
DEFORMATION = re.compile(r"(?P<stretch>lambda|stretch)_?(?P<side>[123])?|F_?(?P<i>[123])(?P<j>[123])|(?P<shear>gamma)")
STRESS = re.compile(r"(?P<kind>P|sigma)_?(?:(?P<i>[123])(?P<j>[123]))?(?:_(?P<unit>[A-Za-z]+))?")
ACCEPTED = (
    "lambda or lambda_1..3 (stretches; sides that are not named are free), gamma (simple shear), F11..F33, and "
    "P_MPa, P12_kPa (first Piola-Kirchhoff) or sigma_MPa (Cauchy)"
)
MOST_LINES = 10**6


def read_table(file: Path) -> LoadingPath:
    """The loading path of a CSV file.

    raises  UserError for unknown or missing columns, missing units, and cells that are not numbers
    """
    header, values = _rows(file)
    deformation = np.full((len(values), 3, 3), np.nan)
    stress = np.full((len(values), 3, 3), np.nan)
    sheared = any(name == "gamma" or (name[0] == "F" and name[-1] != name[-2]) for name in header)
    kinds: set[str] = set()
    for name, column in zip(header, values.T, strict=True):
        if match := DEFORMATION.fullmatch(name):
            place = _place(match)
            if np.isfinite(deformation[(slice(None), *place)]).any():
                raise UserError(f"{file}: the column '{name}' is there twice, under two names; accepted: once")
            deformation[(slice(None), *place)] = column
            continue
        match = STRESS.fullmatch(name)
        if match is None:
            raise UserError(f"{file}: the column '{_shown(name)}' is not known; accepted: {ACCEPTED}")
        if match["unit"] is None:
            raise UserError(f"{file}: the column '{name}' has no unit; accepted: {name}_Pa, {name}_kPa, {name}_MPa")
        i, j = (int(match["i"]) - 1, int(match["j"]) - 1) if match["i"] else (0, 1 if sheared else 0)
        stress[:, i, j] = column * unit_factor(match["unit"], str(file))
        kinds.add(match["kind"])
    _require_both(file, deformation, kinds)
    for i, j in np.ndindex(3, 3):
        if np.isnan(deformation[:, i, j]).all() and (i != j or sheared):
            deformation[:, i, j] = float(i == j)
    free = np.array([bool(np.isnan(deformation[:, k, k]).all()) for k in range(3)])
    kind = STRESSES[1] if "sigma" in kinds else STRESSES[0]
    return check_path(LoadingPath(file.stem, "specimen", deformation, free, stress=stress, is_cauchy=kind == "cauchy"))


def _place(match: re.Match[str]) -> tuple[int, int]:
    """Row and column of F that a column of the table holds."""
    if match["shear"]:
        return 0, 1
    if match["stretch"]:
        side = int(match["side"] or 1) - 1
        return side, side
    return int(match["i"]) - 1, int(match["j"]) - 1


def _require_both(file: Path, deformation: np.ndarray, kinds: set[str]) -> None:
    if not np.isfinite(deformation).any():
        raise UserError(f"{file}: no column holds a deformation; accepted: {ACCEPTED}")
    if not kinds:
        raise UserError(f"{file}: no column holds a stress, P or sigma, and its unit; accepted: {ACCEPTED}")
    if len(kinds) > 1:
        raise UserError(f"{file}: holds P and sigma; accepted: one kind of stress a file")


def _rows(file: Path) -> tuple[list[str], np.ndarray]:
    """Names of the columns, and the numbers, (lines, columns)."""
    with opened_table(file) as text:
        lines = csv.reader(text)
        header = [name.strip() for name in next(lines, [])]
        if not header or len(set(header)) < len(header) or "" in header:
            raise UserError(f"{file}: its first line does not name its columns, each once; accepted: {ACCEPTED}")
        values = []
        for line in lines:
            if not any(cell.strip() for cell in line):
                continue
            if len(line) != len(header) or len(values) >= MOST_LINES:
                raise UserError(f"{file}: line {lines.line_num} has {len(line)} cells; accepted: {len(header)}")
            values.append([_number(cell, name, file, lines.line_num) for name, cell in zip(header, line, strict=True)])
    if not values:
        raise UserError(f"{file}: holds no points; accepted: a line a point under {_shown(','.join(header))}")
    return header, np.array(values)


def _number(cell: str, name: str, file: Path, line: int) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        given = f"{_shown(name)}={_shown(cell.strip())}"
        raise UserError(f"{file}: line {line}: {given} is not a finite number; accepted: a finite number")
    return value


def _shown(text: str) -> str:
    """The beginning of a cell, on one line."""
    return text[:60] if text[:60].isprintable() else ascii(text[:60])
