"""Results of a training on measured stress: relative errors of the paths, as table, JSON and picture."""

import json
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from rich.console import Console
from rich.table import Table

from pcnclaws.atomic import replaced_file
from pcnclaws.commands.runs import METRICS
from pcnclaws.commands.stress_setup import StressData
from pcnclaws.data.loading_paths import LoadingPath
from pcnclaws.guards import counts
from pcnclaws.provenance import provenance
from pcnclaws.training.principal_paths import PrincipalPaths
from pcnclaws.training.stress_fit import StressFit, relative_errors

PICTURE = "stress.png"


@dataclass(frozen=True)
class StressReport:
    """A finished training on stress.

    folders  run folder of each specimen
    started  time.monotonic() when the command began
    """

    folder: Path
    data: StressData
    paths: PrincipalPaths
    fitted: StressFit
    folders: Mapping[str, Path]
    started: float


def write_stress_report(report: StressReport, seed: int, picture: bool, console: Console) -> Mapping[str, float | None]:
    """Prints the table, writes metrics.json and the picture; returns the largest relative errors."""
    from pcnclaws.rendering.stress_curves import draw_stress_curves  # loads matplotlib

    rows = path_rows(report.data.paths, report.paths, report.fitted)
    largest = {
        f"largest relative RMS, {what}": max(
            (row["relative_rms"] for row in rows if row["trained"] == flag), default=None
        )
        for what, flag in (("trained", True), ("left out", False))
    }
    console.print(_table(rows))
    if picture:
        console.print(f"wrote {draw_stress_curves(rows, report.folder / PICTURE)}")
    values = {
        "mse": None,
        **{name.replace(", ", " ").replace(" ", "_"): value for name, value in largest.items()},
        "specimens": [_specimen(report, number) for number in range(len(report.fitted.specimens))],
        "paths": rows,
        "history": {"loss": list(report.fitted.history)},
        "seconds": round(time.monotonic() - report.started, 1),
        "guards": counts(),
        "provenance": provenance(seed, torch.device("cpu")),
    }
    with replaced_file(report.folder / METRICS) as part:
        part.write(json.dumps(values, indent=1).encode())
    console.print(f"wrote {report.folder / METRICS}")
    for specimen in report.fitted.specimens:
        ratio = 0.45 if report.data.is_incompressible else report.data.poissons_ratio
        console.print(
            f"use {specimen.name} with law={report.folders[specimen.name]} "
            f"parameters.youngs_modulus={specimen.youngs_modulus:.4g} parameters.poissons_ratio={ratio:g}"
        )
    return largest


def path_rows(paths: list[LoadingPath] | Any, principal: PrincipalPaths, fitted: StressFit) -> list[dict[str, Any]]:
    """Of each loading path its error, and its curves of measured and predicted stress [Pa]."""
    errors = relative_errors(principal, fitted.predicted)
    rows = []
    for number, (path, error) in enumerate(zip(paths, errors, strict=True)):
        own = principal.path == number
        measured, predicted = (
            (values * principal.size)[own].numpy() for values in (principal.measured, fitted.predicted)
        )
        rows.append(
            {
                "name": path.name,
                "specimen": path.specimen,
                "trained": path.weight > 0.0,
                "relative_rms": error,
                "curves": _curves(path, measured, predicted),
            }
        )
    return rows


def _curves(path: LoadingPath, measured: np.ndarray, predicted: np.ndarray) -> list[dict[str, Any]]:
    """A curve a measured component, over the entry of F that changes the most."""
    i, j = _driven(path)
    curves, first = [], 0
    for row, column in path.measured:
        known = np.isfinite(path.stress[:, row, column])
        last = first + int(known.sum())
        curves.append(
            {
                "stress": f"{'sigma' if path.is_cauchy else 'P'}{row + 1}{column + 1}",
                "deformation": f"F{i + 1}{j + 1}",
                "at": path.deformation[known, i, j].tolist(),
                "measured": [float(f"{value:.6g}") for value in measured[first:last]],
                "predicted": [float(f"{value:.6g}") for value in predicted[first:last]],
            }
        )
        first = last
    return curves


def _driven(path: LoadingPath) -> tuple[int, int]:
    spans = np.ptp(path.deformation, axis=0)
    spans[path.free, path.free] = 0.0
    i, j = np.unravel_index(int(np.argmax(spans)), (3, 3))
    return int(i), int(j)


def _specimen(report: StressReport, number: int) -> dict[str, Any]:
    found = report.fitted.specimens[number]
    return {
        "name": found.name,
        "youngs_modulus": found.youngs_modulus,
        "poissons_ratio": report.data.poissons_ratio,
        "scale": float(np.exp(found.scale)),
        "shape": list(found.shape),
        "folder": str(report.folders[found.name].relative_to(report.folder)),
    }


def _table(rows: list[dict[str, Any]]) -> Table:
    table = Table(title="Error of the stress, RMS over that of the measured stress")
    for name in ("path", "specimen", "use", "relative RMS"):
        table.add_column(name, justify="right" if name == "relative RMS" else "left", no_wrap=True)
    for row in rows:
        use = "trained" if row["trained"] else "left out"
        table.add_row(row["name"], row["specimen"], use, f"{100.0 * row['relative_rms']:.1f} %")
    return table
