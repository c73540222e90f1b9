"""Coverage: how often intervals of 95 % hold the truth, of random bodies whose markers scatter.

Parameters and motions are drawn from the ranges of the training data, the model is right: the noise is all that errs.
A search begins at the truth, since what is tried is the interval and not the search.
source  Talts et al. 2018, "Validating Bayesian inference algorithms with simulation-based calibration"
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table
from scipy.stats import beta, norm

from benchmarks.charts import COLOURS, decorate, panels, save, table_of
from benchmarks.checks import names, whole
from benchmarks.context import BenchmarkContext, Checkpointed
from benchmarks.which_material import KINDS, searched, seen_markers
from pcnclaws.data.sampling import DataSetPlan, draw_motions, draw_parameters
from pcnclaws.errors import UserError
from pcnclaws.estimation.goodness_of_fit import fit_of
from pcnclaws.estimation.problem import EstimationProblem
from pcnclaws.estimation.profiles import profile
from pcnclaws.estimation.uncertainty import ROUNDING, uncertainty
from pcnclaws.estimation.unknowns import components_of, make_unknowns
from pcnclaws.geometry.shapes import particles, spin_velocity
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.materials import Material, material_named
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.scenes import SceneStart

# With it, the draws are apart from those of data sets and calibrations.
STREAM = 23
LEVEL = 0.95


def run(options: Mapping[str, Any], context: BenchmarkContext) -> dict[str, Any]:
    """Estimates and intervals of each object.

    {"rows": [{"object", "kind", "fitted", "seconds", "numbers": {name: {"truth", "estimate", "linear", "told",
    "deviations", "profile"}}}]}: intervals as [low, high]; deviations of the estimate from the truth, in coordinates;
    linear None without influence, profile None where none was made
    """
    kinds = names(options, "kinds", KINDS)
    objects, profiles = whole(options, "objects"), whole(options, "profiles", least=0)
    whole(options, "particles_per_edge", least=6)  # a hundred of them on the surface
    for name in ("steps", "every", "iterations"):
        whole(options, name)
    if not 0.0 < options["noise"] < 0.1:
        raise UserError(f"problem.noise={options['noise']} is not accepted; accepted: above 0 and below 0.1 [m]")
    done = Checkpointed.load(context.folder, "coverage", {"options": dict(options), "seed": context.seed})
    starts = {kind: _starts(material_named(kind), -(-objects // len(kinds)), options, context.seed) for kind in kinds}
    rows = []
    for number in range(objects):
        kind = kinds[number % len(kinds)]
        start = starts[kind][number // len(kinds)]
        context.advance(number, objects, f"{kind} {start.name}")

        def made(start: SceneStart = start, number: int = number) -> dict[str, Any]:
            return _estimated(start, options, (context.seed, STREAM, number), number < profiles)

        rows.append(done.row(f"{kind} {start.name}", made))
    context.advance(objects, objects, "done")
    return {"rows": rows}


def covered(rows: Sequence[Mapping[str, Any]], kind: str, name: str, way: str) -> tuple[int, int]:
    """How many intervals of a parameter hold the truth, and of how many; without those of no influence."""
    numbers = [row["numbers"][name] for row in rows if row["kind"] == kind and row["numbers"][name][way] is not None]
    return sum(one[way][0] <= one["truth"] <= one[way][1] for one in numbers), len(numbers)


def tables(document: Mapping[str, Any]) -> list[Table]:
    """The shares of intervals that hold the truth, a line a parameter."""
    rows = document["results"]["rows"]
    table = table_of("95 % intervals that hold the truth", "material", "number", "linear", "", "profile", "", "told")
    for kind in dict.fromkeys(row["kind"] for row in rows):
        for name in material_named(kind).parameter_names:
            cells = [cell for way in ("linear", "profile") for cell in _words(*covered(rows, kind, name, way))]
            told = [row["numbers"][name]["told"] for row in rows if row["kind"] == kind]
            table.add_row(kind, name, *cells, f"{sum(told)} of {len(told)}")
    sums = [np.sum([covered(rows, *key, way) for key in _keys(rows)], axis=0) for way in ("linear", "profile")]
    table.add_row("all", "", *(cell for held, count in sums for cell in _words(int(held), int(count))), "")
    return [table]


def draw(document: Mapping[str, Any], folder: Path) -> list[Path]:
    """Differences from the truth in deviations beside the normal distribution; shares of intervals that hold it."""
    rows = document["results"]["rows"]
    figure, (left, right) = panels(2)
    away = [one["deviations"] for row in rows for one in row["numbers"].values() if one["deviations"] is not None]
    place = np.linspace(-4.0, 4.0, 161)
    left.hist(np.clip(away, -4.0, 4.0), bins=33, density=True, color=COLOURS[0], alpha=0.4)
    left.plot(place, norm.pdf(place), color="0.3", linewidth=1.0, label="normal distribution")
    decorate(left, "difference from the truth [deviations]", "density [-]")
    left.legend(fontsize=7, frameon=False)
    for number, way in enumerate(("linear", "profile")):
        for height, key in enumerate(_keys(rows)):
            held, count = covered(rows, *key, way)
            if count:
                low, high = _band(held, count)
                middle = height + 0.25 * number
                right.plot([100 * low, 100 * high], 2 * [middle], color=COLOURS[number], linewidth=1.2)
                right.plot(100 * held / count, middle, "o", color=COLOURS[number], label=way if height == 0 else None)
    right.axvline(100 * LEVEL, color="0.3", linewidth=1.0)
    right.set_yticks(range(len(_keys(rows))), [" ".join(key).replace("_", " ") for key in _keys(rows)], fontsize=7)
    decorate(right, "intervals that hold the truth [%]", "")
    right.legend(fontsize=7, frameon=False)
    return [save(figure, folder / f"{document['problem']}.png")]


def _keys(rows: Sequence[Mapping[str, Any]]) -> list[tuple[str, str]]:
    kinds = dict.fromkeys(row["kind"] for row in rows)
    return [(kind, name) for kind in kinds for name in material_named(kind).parameter_names]


def _words(held: int, count: int) -> tuple[str, str]:
    """The share, and between which the chance is with 95 % certainty."""
    if not count:
        return "", ""
    low, high = _band(held, count)
    return f"{held} of {count}", f"{100 * low:.0f} to {100 * high:.0f} %"


def _band(held: int, count: int) -> tuple[float, float]:
    """The interval of Clopper and Pearson of the chance that an interval holds the truth."""
    low = float(beta.ppf(0.5 * (1.0 - LEVEL), held, count - held + 1)) if held else 0.0
    high = float(beta.ppf(0.5 * (1.0 + LEVEL), held + 1, count - held)) if held < count else 1.0
    return low, high


def _starts(material: Material, count: int, options: Mapping[str, Any], seed: int) -> list[SceneStart]:
    """Bodies of random parameters, thrown at random."""
    body = particles("cube", (0.5, 0.35, 0.5), options["side"], options["particles_per_edge"], "centres")
    settings = DataSetPlan(material).settings
    draws = zip(draw_parameters(material, count, (seed, STREAM)), draw_motions(count, (seed, STREAM)), strict=True)
    return [
        SceneStart(
            f"object-{number:03d}",
            material.name,
            settings,
            parameters,
            position=body.position,
            velocity=spin_velocity(body.position, body.velocity + motion.velocity, motion.spin.tolist()),
            volume=body.volume,
        )
        for number, (parameters, motion) in enumerate(draws)
    ]


def _estimated(
    start: SceneStart, options: Mapping[str, Any], seed: tuple[int, ...], with_profile: bool
) -> dict[str, Any]:
    began, material = time.monotonic(), material_named(start.material)
    laws = analytic_laws(material)
    record = simulate_records([start], laws, FramePlan(options["steps"], options["every"]))[0]
    seen = seen_markers(record, float(options["noise"]), np.random.default_rng(seed))
    observation = replace(seen, initial_velocity=start.velocity)
    parts = components_of("uniform", observation.position, observation.spacing)
    unknowns = make_unknowns(material.parameter_names, {}, parts, parts, motion=False, time_offset=False)
    problem = EstimationProblem(laws, observation, unknowns)
    truth = [start.parameters[unknown.name] for unknown in unknowns.sought]
    u, here, _ = searched(problem, unknowns.coordinates(truth), options["iterations"])
    found = uncertainty(here, unknowns, u, ROUNDING)
    numbers = {}
    for number, (unknown, one, true) in enumerate(zip(unknowns.sought, found.estimates, truth, strict=True)):
        felt = bool(np.isfinite(found.error_variance[number]))
        followed = profile(problem, u, found, number) if with_profile and felt else None
        away = u[number] - unknown.transform.coordinate(true)
        numbers[unknown.name] = {
            "truth": true,
            "estimate": one.value,
            "linear": list(one.interval) if felt else None,
            "told": one.identifiable,
            "deviations": float(away / np.sqrt(found.covariance[number, number])) if felt else None,
            "profile": None if followed is None else list(followed.interval),
        }
    fit = fit_of(problem, u, found)
    return {
        "object": start.name,
        "kind": material.name,
        "fitted": fit.fitted,
        "numbers": numbers,
        "seconds": time.monotonic() - began,
    }
