"""Model discrepancy: by how much the error of a law moves markers as the unknowns would [m]."""

import json
import logging
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pcnclaws.data.law_packages import law_files
from pcnclaws.data.observation_files import from_record
from pcnclaws.errors import UserError
from pcnclaws.estimation.levenberg_marquardt import LevenbergMarquardt
from pcnclaws.estimation.problem import EstimationProblem
from pcnclaws.estimation.uncertainty import QUANTILE_95, ROUNDING, projected_error
from pcnclaws.estimation.unknowns import components_of, make_unknowns
from pcnclaws.laws.analytic import Laws
from pcnclaws.laws.materials import Material
from pcnclaws.simulation.records import SceneRecord

log = logging.getLogger(__name__)

CALIBRATION = "estimation.json"
COVERAGE = 0.95
MOST_ITERATIONS = 6


def known_law_error(folder: Path | None) -> float:
    """The calibrated error of the law in a folder or a package [m]; the rounding of the analytic law for None.

    Where no calibration was made, one line says so, and the error is that of the law's own validation.
    """
    if folder is None:
        return ROUNDING
    with law_files(folder) as files:
        if (files / CALIBRATION).is_file():
            return max(_calibration(files / CALIBRATION), ROUNDING)
        error = _validation_error(files)
    log.warning(
        "law=%s is not calibrated for estimation: its intervals follow from its validation error (%.1e m); "
        "python -m pcnclaws.calibrate law=%s calibrates it",
        folder,
        error,
        folder,
    )
    return max(error, ROUNDING)


def is_calibrated(folder: Path) -> bool:
    """Whether the error of the law in a folder or a package is known."""
    with law_files(folder) as files:
        return (files / CALIBRATION).is_file()


def _calibration(path: Path) -> float:
    try:
        return float(json.loads(path.read_text(encoding="utf-8"))["law_error"])
    except (ValueError, LookupError, TypeError, OSError, OverflowError, RecursionError) as fault:
        raise UserError(f"{path}: cannot be read; accepted: the output of python -m pcnclaws.calibrate") from fault


def calibrated_error(
    material: Material,
    laws: Laws,
    records: Sequence[SceneRecord],
    progress: Callable[[int], None] | None = None,
) -> dict[str, Any]:
    """The error that makes intervals of 95 % right on objects whose truth is known.

    Each object is estimated from its true parameters; what the estimate is off by is the law's doing. The error of the
    law is the quantile, over all objects and parameters, that covers 95 % of these differences (split conformal
    prediction, Vovk et al. 2005).
    records  of the objects, by the analytic law, with their parameters
    returns  plain values: "law_error" [m], "objects", and "differences" and "projected" of each
    """
    projected, differences = [], []
    for record in records:
        difference, error = _difference(material, laws, record)
        projected.append(error)
        differences.append(difference)
        if progress:
            progress(1)
    scores = np.sort(np.concatenate(projected)) / QUANTILE_95
    rank = min(math.ceil(COVERAGE * (len(scores) + 1)), len(scores)) - 1
    return {
        "law_error": float(scores[rank]),
        "objects": len(records),
        "names": list(material.parameter_names),
        "relative_differences": [difference.tolist() for difference in differences],
        "projected": [error.tolist() for error in projected],
    }


def _difference(material: Material, laws: Laws, record: SceneRecord) -> tuple[np.ndarray, np.ndarray]:
    """Estimated over true parameters less 1, and the projected error of each [m]."""
    observation = from_record(record)
    whole = components_of("uniform", observation.position, observation.spacing)
    unknowns = make_unknowns(material.parameter_names, {}, whole, whole, motion=False, time_offset=False)
    problem = EstimationProblem(laws, observation, unknowns)
    truth = np.array([record.parameters[unknown.name] for unknown in unknowns.sought])
    start = unknowns.coordinates(truth.tolist())
    u, search = start.copy(), LevenbergMarquardt(damping=1e-6)
    here = problem.linearise(u)
    for _ in range(MOST_ITERATIONS):
        step = search.step(here, unknowns.reach(u))
        there = problem.linearise(u + step)
        if search.judge(here.mse, there.mse, step):
            u, here = u + step, there
        if search.done:
            break
    return unknowns.values(u) / truth - 1.0, projected_error(here, u - start)


def _validation_error(folder: Path) -> float:
    """Root of the mean squared error of a run's best check [m]; 1 mm where it is not noted."""
    try:
        notes: Mapping[str, Any] = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
        return math.sqrt(float(notes["training"]["validation_mse"]))
    except (OSError, ValueError, LookupError, TypeError, OverflowError, RecursionError):
        return 1e-3
