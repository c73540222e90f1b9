"""Results of an evaluation as JSON and as a table."""

import json
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table

from pcnclaws.atomic import replaced_file
from pcnclaws.evaluation.divergence import DivergedScene
from pcnclaws.evaluation.tasks import SceneResult, mean_mse
from pcnclaws.laws.parameters import PARAMETERS

Outcomes = Sequence[SceneResult | DivergedScene]

UNITS = {
    "mse": "m^2, mean over particles, coordinates and the compared frames, the first one included",
    "mse_sum": "m^2, the same with the coordinates summed",
    "rms_percent": "root of mse_sum in percent of the object's size (cube root of its initial volume)",
    "stress_error": "sum |tau - tau_true| / sum |tau_true| at the recorded states after contact",
    "energy_error": "max |E - E_true| / max (kinetic + elastic energy of the true motion), over the keyframes",
    "rollout_seconds": "s of wall-clock time, mean over scenes; of scenes that ran as one batch their share of it",
}
# Significant digits of curves.
CURVE_DIGITS = 4
LONGEST_NAME = 24
# Of more scenes than this, a table shows only the worst ones.
LONGEST_TABLE, WORST = 40, 10


def metrics(outcomes: Outcomes, curves: bool = True) -> dict[str, Any]:
    """Errors of the scenes and their means, as plain values for a JSON file.

    {"mse", "mse_sum", "rms_percent", "stress_error", "energy_error", "rollout_seconds",
     "scenes": [{"name", "parameters", ...}], "units"};
    null where a value does not exist. A scene that diverged has no errors but "diverged", which says how; the means
    are those of the others.
    curves  whether each scene has its "time" and "mse_by_frame", rounded to CURVE_DIGITS
    """
    results = survived(outcomes)
    return {
        "mse": mean_mse(results),
        "mse_sum": _mean_if_any([result.mse_sum for result in results]),
        "rms_percent": _mean_if_any([result.rms_percent for result in results]),
        "stress_error": _mean_if_any([result.stress_error for result in results]),
        "energy_error": _mean_if_any([result.energy_error for result in results]),
        "rollout_seconds": _mean_if_any([result.seconds for result in results]),
        "scenes": [_scene_metrics(outcome) | (_curve(outcome) if curves else {}) for outcome in outcomes],
        "units": UNITS,
    }


def survived(outcomes: Outcomes) -> list[SceneResult]:
    """The scenes that did not diverge."""
    return [outcome for outcome in outcomes if isinstance(outcome, SceneResult)]


def write_metrics(path: Path, values: Mapping[str, Any]) -> Path:
    """Writes a JSON file, whole or not at all; what is not a finite number becomes null."""
    with replaced_file(path) as unfinished:
        text = json.dumps(_plain(values), indent=2, ensure_ascii=False, allow_nan=False)
        unfinished.write(f"{_numbers_on_one_line(text)}\n".encode())
    return path


def results_table(
    outcomes: Outcomes,
    title: str = "",
    before: Sequence[SceneResult] = (),
    published: Mapping[str, float] | None = None,
) -> Table:
    """One line a scene and the mean; of many scenes, only the worst ones.

    before     the same scenes before training, for a column beside
    published  mse [m^2] of the paper by scene name, for another one
    """
    names = list(outcomes[0].parameters)
    table = Table(title=escape(title) or None, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    shown = _worst(outcomes)
    table.add_column("scene", overflow="fold", min_width=min(LONGEST_NAME, max(len(result.name) for result in shown)))
    for header in (
        *(_header(name) for name in names),
        "MSE [m^2]",
        *(["before training"] if before else []),
        *(["paper"] if published else []),
        "RMS [% of size]",
        "stress error",
        "energy error",
    ):
        table.add_column(escape(header), justify="right", min_width=max(map(len, header.split())))
    earlier = {result.name: result.mse for result in before}
    for result in shown:
        beside = [earlier.get(result.name)] * bool(before) + [(published or {}).get(result.name)] * bool(published)
        values = (f"{result.parameters[name] * _factor(name):.4g}" for name in names)
        table.add_row(escape(result.name), *values, *_errors(_scene_metrics(result), beside))
    table.add_section()
    beside = [_mean_if_any(list(earlier.values()))] * bool(before) + [None] * bool(published)
    table.add_row(_mean_label(outcomes), *[""] * len(names), *_errors(metrics(outcomes), beside))
    return table


def _worst(outcomes: Outcomes) -> Outcomes:
    """All outcomes of a short list; of a long one, the results with the largest errors."""
    if len(outcomes) <= LONGEST_TABLE:
        return outcomes
    worst = sorted(survived(outcomes), key=lambda result: result.mse, reverse=True)
    return worst[:WORST] or outcomes[:WORST]


def _mean_label(outcomes: Outcomes) -> str:
    diverged = len(outcomes) - len(survived(outcomes))
    count = f" of {len(outcomes)}" if len(outcomes) > LONGEST_TABLE else ""
    return f"mean{count}" + (f", {diverged} diverged" if diverged else "")


def _header(name: str) -> str:
    return PARAMETERS[name].header if name in PARAMETERS else name


def _factor(name: str) -> float:
    """From SI units to those of the header."""
    return PARAMETERS[name].display_factor if name in PARAMETERS else 1.0


def _errors(values: Mapping[str, Any], beside: Sequence[float | None]) -> list[str]:
    """The cells of one line that hold errors; `beside` are other values of the MSE."""
    mse = "diverged" if "diverged" in values else _number(values["mse"])
    percent = values["rms_percent"]
    return [
        mse,
        *map(_number, beside),
        "-" if percent is None else f"{percent:.2g}",
        _number(values["stress_error"]),
        _number(values["energy_error"]),
    ]


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.1e}"


def _scene_metrics(outcome: SceneResult | DivergedScene) -> dict[str, Any]:
    """Name, parameters and errors of a scene; of a diverged one, none and why."""
    errors = ("mse", "mse_sum", "rms_percent", "stress_error", "energy_error")
    values = {"name": outcome.name, "parameters": dict(outcome.parameters)}
    if isinstance(outcome, DivergedScene):
        return values | dict.fromkeys(errors) | {"diverged": outcome.message}
    return values | {error: getattr(outcome, error) for error in errors}


def _curve(outcome: SceneResult | DivergedScene) -> dict[str, list[float]]:
    """The error over time of a scene, in few digits: enough for a picture, and a file that stays small."""
    if isinstance(outcome, DivergedScene):
        return {}
    return {"time": _rounded(outcome.time), "mse_by_frame": _rounded(outcome.mse_by_frame)}


def _rounded(values: np.ndarray) -> list[float]:
    return [float(f"{value:.{CURVE_DIGITS}g}") for value in values.tolist()]


def _numbers_on_one_line(text: str) -> str:
    """Lists of numbers, one a line, as one line a list."""
    return re.sub(r"\[[\s\d.,e+null-]+\]", lambda match: " ".join(match[0].split()), text)


def _mean_if_any(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def _plain(value: object) -> object:
    """The value with None for numbers that JSON has no word for."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
