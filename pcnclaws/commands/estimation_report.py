"""Results of an estimation: a table, a JSON file and pictures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table

from pcnclaws.data.observation import Observation
from pcnclaws.estimation.discrepancy import Discrepancy
from pcnclaws.estimation.goodness_of_fit import Fit
from pcnclaws.estimation.uncertainty import CORRELATED, Estimate, Uncertainty
from pcnclaws.estimation.unknowns import Unknowns
from pcnclaws.laws.parameters import PARAMETERS
from pcnclaws.rendering.pictures import predicted_beside_true
from pcnclaws.rendering.search_convergence import Course, convergence
from pcnclaws.simulation.records import SceneRecord

UNITS = (
    {"velocity": "m/s", "spin": "rad/s", "walls": "m", "tilt": "deg"}
    | dict.fromkeys(("time_offset",), "s")
    | dict.fromkeys(("surface_offset", "grid_spacing"), "m")
)


# Usual causes of a motion that is not fitted.
CAUSES = (
    "usual causes: axes (y is up), frame rate, units, gravity, walls, body, material, a given start velocity, a search "
    "that ended beside the minimum (screening=32), or smoothed positions (observation.noise= [m] says their error)"
)
# By Fit.fitted: the entry of `verdicts` for programs.
CODES = {False: ["not_fitted"], None: ["fit_not_known"], True: []}


@dataclass(frozen=True)
class Findings:
    """What a search has ended with.

    guess  value of each unknown where the search began
    truth  physical parameters that the file stores, by name
    """

    title: str
    unknowns: Unknowns
    guess: Sequence[float]
    found: Uncertainty
    fit: Fit
    truth: Mapping[str, float]


def result_table(findings: Findings) -> Table:
    """One line an unknown: guess, estimate, interval, and the truth where the file stores it."""
    found, fit, truth = findings.found, findings.fit, findings.truth
    fixed = {name: float(values[0]) for name, values in findings.unknowns.fixed.items()}
    table = Table(title=findings.title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.add_column("", overflow="fold")
    for header in ("guess", "estimate", "95 % interval", *(["truth", "off by"] if truth else [])):
        table.add_column(header, justify="right")
    for start, estimate in zip(findings.guess, found.estimates, strict=True):
        true = true_value(estimate.label, truth)
        beside = [] if not truth else [_number(true), _difference(estimate, true)]
        low, high = estimate.interval
        interval = f"{low:.4g} to {high:.4g}" if fit.has_intervals else "none"
        cells = [_number(estimate.value), interval] if estimate.identifiable else ["not told", "-"]
        table.add_row(escape(f"{estimate.label} [{_unit(estimate.label)}]"), _number(start), *cells, *beside)
    for name, value in fixed.items():
        table.add_row(escape(f"{name} [{_unit(name)}]"), _number(value), "fixed", "-", *[""] * (2 if truth else 0))
    return table


def verdicts(found: Uncertainty, fit: Fit) -> list[str]:
    """In words: whether the search has ended, what the motion does not tell or tell apart, and whether it is fitted."""
    lines = []
    ahead = [estimate for estimate in found.estimates if estimate.identifiable and not estimate.converged]
    if ahead:
        numbers = ", ".join(f"{estimate.label} {estimate.ahead:.4g}" for estimate in ahead)
        reach = "; the intervals reach there" if fit.has_intervals else ""
        lines.append(
            f"the search stopped on its way: one more Gauss-Newton step leads to {numbers}{reach}. "
            "More iterations (estimator.iterations), or estimator=gauss_newton, will get nearer"
        )
    where = "where the search stopped" if ahead else "from this motion"
    for number, estimate in enumerate(found.estimates):
        if not estimate.identifiable:
            felt = bool(np.isfinite(found.covariance[number, number]))
            low, high = estimate.interval
            interval = f"{low:.3g} to {high:.3g}" if fit.has_intervals else "too wide"
            why = f"its interval is {interval}" if felt else "it has no influence on what was observed"
            lines.append(f"{estimate.label} cannot be told {where}: {why}")
    labels = [estimate.label for estimate in found.estimates]
    for i, j in zip(*np.nonzero(np.triu(np.abs(found.correlation), 1) > CORRELATED), strict=True):
        lines.append(f"{labels[i]} and {labels[j]} stand for one another (correlation {found.correlation[i, j]:.3f})")
    return [*lines, *_fit_verdict(fit)]


def _fit_verdict(fit: Fit) -> list[str]:
    """One line where the motion is not fitted, or where that cannot be told."""
    if fit.fitted:
        alike = "neighbouring markers are off alike: "
        return [] if fit.discrepancy is None else [alike + _discrepancy(fit.discrepancy)]
    if fit.fitted is False:
        without = "the estimate has no interval (discrepancy=true makes one that reckons with an error of the model)"
        intervals = without if fit.discrepancy is None else _discrepancy(fit.discrepancy)
        return [f"the motion is not fitted: {', '.join(_misfit(fit))}; {intervals}; {CAUSES}"]
    if fit.freedom < 1:
        why = "there are not more observed coordinates than unknowns"
        lacking = "" if fit.has_intervals else "; without observation.noise= [m] the estimate has no interval"
        return [f"whether the motion is fitted cannot be told: {why}{lacking}"]
    why = f"residual {_length(fit.residual)}, and too few frames and markers to tell how much the positions scatter"
    return [f"whether the motion is fitted cannot be told: {why}; observation.noise= [m] says it"]


def _misfit(fit: Fit) -> list[str]:
    """The residual beside what would be right, and its pattern."""
    words = [f"residual {_length(fit.residual)}"]
    if fit.scatter:
        bound = "" if fit.scatter.given else "at most "
        words.append(f"the positions scatter by {bound}{_length(fit.scatter.size)} ({fit.scatter.known})")
    if fit.tolerance > (fit.scatter.size if fit.scatter else 0.0):
        words.append(f"law and simulation are right to {_length(fit.tolerance)}")
    if fit.alike is not None:
        words.append(f"it is alike in neighbouring frames (correlation {fit.alike:.2f})")
    if fit.odd:
        many = "one marker holds" if len(fit.odd) == 1 else f"{len(fit.odd)} markers hold"
        words.append(f"{many} more than half of its square: are labels exchanged?")
    if fit.stray:
        words.append(f"{fit.stray} points far from the surface hold more than half of its square: background?")
    return words


def _discrepancy(found: Discrepancy) -> str:
    return (
        f"the intervals take it for an error of the model of {_length(found.size)}, alike over {found.time:.2g} s and "
        f"{found.length:.2g} m, with {found.patterns:.0f} independent values"
    )


def _length(size: float) -> str:
    return f"{1e3 * size:.2g} mm"


def result_values(findings: Findings, beside: Sequence[str] = ()) -> dict[str, Any]:
    """The result as plain values: {"parameters": {label: {...}}, "motion": {...}, "fit": {...}, "noise", ...}.

    beside  more verdicts in words

    An estimate without an interval is the best fit of a motion that is not fitted, and not identifiable.
    """
    found, fit, truth = findings.found, findings.fit, findings.truth
    parameters: dict[str, Any] = {}
    motion: dict[str, Any] = {}
    for start, unknown, estimate in zip(findings.guess, findings.unknowns.sought, found.estimates, strict=True):
        known = estimate.identifiable
        values = {
            "guess": start,
            "estimate": estimate.value if known else None,
            "interval_95": list(estimate.interval) if known and fit.has_intervals else None,
            "identifiable": known and fit.has_intervals,
            "converged": estimate.converged,
            "law_share": estimate.law_share,
            "unit": _unit(estimate.label),
        }
        if (true := true_value(estimate.label, truth)) is not None:
            values["truth"] = true
        (parameters if unknown.name in PARAMETERS else motion)[estimate.label] = values
    return {
        "parameters": parameters,
        "motion": motion,
        "verdicts": [*CODES[fit.fitted], *verdicts(found, fit), *beside],
        "fit": _fit_values(fit),
        "correlation": found.correlation.tolist(),
        "noise": found.noise,
        "law_error": found.law_error,
    }


def _fit_values(fit: Fit) -> dict[str, Any]:
    return {
        "fitted": fit.fitted,
        "residual": fit.residual,
        "scatter": fit.scatter.size if fit.scatter else None,
        "scatter_from": fit.scatter.known if fit.scatter else None,
        "alike": fit.alike,
        "tolerance": fit.tolerance,
        "odd_markers": list(fit.odd),
        "stray_points": fit.stray,
        "discrepancy": None if fit.discrepancy is None else _discrepancy_values(fit.discrepancy),
    }


def _discrepancy_values(found: Discrepancy) -> dict[str, float]:
    return {name: getattr(found, name) for name in ("size", "time", "length", "patterns")}


def leave_estimation_pictures(
    stem: Path,
    findings: Findings,
    observation: Observation,
    beside: tuple[Float[np.ndarray, "frames positions 3"], Float[np.ndarray, "frames positions 3"]],
    history: Sequence[tuple[Sequence[float], float]],
) -> list[Path]:
    """<stem>_convergence.png: unknowns and error over the iterations; <stem>_fit.png: observed beside simulated.

    beside  positions that were observed, and where the simulation puts them [m]
    """
    fit = findings.fit
    warning = f"not fitted: {', '.join(_misfit(fit)[:2])}" if fit.fitted is False else ""
    courses = [
        Course(
            estimate.label,
            [values[k] for values, _ in history],
            estimate.interval if estimate.identifiable and fit.has_intervals else None,
            true_value(estimate.label, findings.truth),
        )
        for k, estimate in enumerate(findings.found.estimates)
    ]
    title = f"{findings.title}\n{warning}".strip()
    search = convergence(courses, [mse for _, mse in history], title, stem.with_name(f"{stem.name}_convergence.png"))
    observed, simulated = (_as_record(observation, position) for position in beside)
    path = stem.with_name(f"{stem.name}_fit.png")
    words = ("observed", "simulated")
    return [search, predicted_beside_true(observed, simulated, path, words=words, warning=warning)]


def true_value(label: str, truth: Mapping[str, float]) -> float | None:
    """The stored value of an unknown; None where it is not stored, and for parts of a scene."""
    return truth.get(label)


def _as_record(observation: Observation, position: np.ndarray) -> SceneRecord:
    """Markers or points as a scene that can be drawn; a few are drawn as large as the particles around them."""
    markers = position.shape[1]
    volume = np.full(markers, observation.volume.mean(), dtype=np.float32)
    return SceneRecord(
        observation.name,
        observation.material,
        observation.settings,
        {},
        time=observation.time,
        position=position.astype(np.float32),
        volume=volume,
    )


def _unit(label: str) -> str:
    name = label.partition("[")[0]
    return PARAMETERS[name].unit if name in PARAMETERS else UNITS.get(name.rpartition("_")[0], UNITS.get(name, "-"))


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.5g}"


def _difference(estimate: Estimate, true: float | None) -> str:
    if true is None or not estimate.identifiable:
        return ""
    difference = estimate.value - true
    relative = PARAMETERS[estimate.label.partition("[")[0]].unit == "Pa"
    return f"{100.0 * difference / true:+.2g} %" if relative else f"{difference:+.2g}"
