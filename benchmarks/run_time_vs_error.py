"""Run time against error, over everything that trades one for the other.

drop, bounce          scenes on the floor, against a finer run of the same law, every material
bar, wave, rotation   motions with a known answer, of an elastic body
"""

from collections.abc import Mapping
from dataclasses import asdict
from functools import partial
from itertools import product
from typing import Any

import numpy as np
import torch

from benchmarks.cases import NEURAL_MODEL
from benchmarks.context import BenchmarkContext, Checkpointed
from benchmarks.convergence import orders_table, reference_errors
from benchmarks.floor_scenes import FLOOR_SCENES
from benchmarks.free_motions import FreeMotion
from benchmarks.run_time_vs_error_report import draw, tables
from benchmarks.sweep import Trial, automatic_of, presets_of, trials_of
from benchmarks.timed_runs import cost_of_run, timed_run
from pcnclaws.errors import SimulationDiverged, UserError
from pcnclaws.laws.analytic import Laws, analytic_laws
from pcnclaws.laws.materials import Material, material_named
from pcnclaws.laws.neural import build_neural_laws

__all__ = ["draw", "run", "tables"]

NAME = "run_time_vs_error"


def run(options: Mapping[str, Any], context: BenchmarkContext) -> dict[str, Any]:
    """Run time and error of every setting.

    {"rows": [{"problem", "material", "law", settings, cost, "error", ...}], "references", "orders", "presets",
    "automatic": settings of simulation.time_step=auto, "neural_laws"}; the errors of the floor scenes are in units of
    the body's size, the others relative to the displacement; null for a run that diverged
    """
    trials, finer = trials_of(options)
    laws = _laws(options, context, trials)
    key = {"options": dict(options), "seed": context.seed, "device": str(context.device)}
    stored = Checkpointed.load(context.folder, NAME, key | {"threads": torch.get_num_threads()})
    total = len(finer) + len(trials)
    references = {}
    for number, trial in enumerate(finer):
        context.advance(number, total, f"reference {trial.name}")
        make = partial(_reference, trial, laws[trial.material, trial.law], context.device)
        references[trial.series] = stored.row(f"reference {trial.name}", make)
    rows = []
    for number, trial in enumerate(trials):
        context.advance(len(finer) + number, total, trial.name)
        make = partial(_row, trial, laws[trial.material, trial.law], references.get(trial.series), context.device)
        rows.append(stored.row(trial.name, make))
    context.advance(total, total, "done")
    return _results(rows, list(references.values()), options)


def _results(
    rows: list[dict[str, Any]], references: list[dict[str, Any]], options: Mapping[str, Any]
) -> dict[str, Any]:
    plain = [{key: value for key, value in row.items() if key != "means"} for row in references]
    orders = orders_table(rows, plain)
    return {
        "rows": rows,
        "references": reference_errors(plain, orders),
        "orders": orders,
        "presets": {name: asdict(resolution) for name, resolution in presets_of(options).items()},
        "automatic": [
            {"problem": problem, "material": material} | asdict(resolution)
            for problem, material in product(options["problems"], options["materials"])
            for resolution in automatic_of(options, problem, material)
        ],
        "neural_laws": str(options["law"] or "untrained, of the seed: compared with themselves alone"),
    }


def _reference(trial: Trial, laws: Laws, device: torch.device) -> dict[str, Any]:
    """Settings, cost and "means" of a run that others are compared with."""
    scenario = FLOOR_SCENES[trial.problem](trial.material)
    done = timed_run(scenario, laws, trial.resolution, device)
    return _plain(trial) | cost_of_run(done, scenario.duration) | {"means": scenario.means(done).tolist()}


def _row(trial: Trial, laws: Laws, reference: Mapping[str, Any] | None, device: torch.device) -> dict[str, Any]:
    """Settings, cost and errors of one run."""
    scenario = trial.scenario
    try:
        done = timed_run(scenario, laws, trial.resolution, device)
    except SimulationDiverged as error:
        return _plain(trial) | {"error": None, "diverged": str(error)}
    if isinstance(scenario, FreeMotion):
        errors = scenario.errors(done)
    else:
        errors = scenario.errors(scenario.means(done), np.asarray(reference["means"] if reference else None))
    return _plain(trial) | cost_of_run(done, scenario.duration) | errors


def _plain(trial: Trial) -> dict[str, Any]:
    names_of_series = dict(zip(("problem", "material", "law"), trial.series, strict=True))
    return names_of_series | asdict(trial.resolution)


def _laws(options: Mapping[str, Any], context: BenchmarkContext, trials: list[Trial]) -> dict[tuple[str, str], Laws]:
    """Laws by material and kind; the neural ones of problem.law, or untrained ones of the seed."""
    found: dict[tuple[str, str], Laws] = {}
    for material, law in dict.fromkeys((trial.material, trial.law) for trial in trials):
        known = material_named(material)
        if law == "analytic":
            found[material, law] = analytic_laws(known)
        elif options["law"] is None:
            torch.manual_seed(context.seed)
            found[material, law] = build_neural_laws(known, NEURAL_MODEL)
        else:
            found[material, law] = _chosen_laws(str(options["law"]), known, context)
    return found


def _chosen_laws(law: str, material: Material, context: BenchmarkContext) -> Laws:
    try:
        return context.laws(law, material)
    except UserError as fault:
        raise UserError(f"problem.{fault}") from fault
