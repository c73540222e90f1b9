"""Run time against error, over everything that trades one for the other.

drop, bounce          scenes on the floor, against a finer run of the same law, every material
bar, wave, rotation   motions with a known answer, of an elastic body
"""

from collections.abc import Mapping
from dataclasses import asdict, replace
from functools import partial
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import torch

from pcnclaws.backend import BACKENDS
from pcnclaws.benchmarking.cases import NEURAL_MODEL
from pcnclaws.benchmarking.checks import names, numbers, wholes
from pcnclaws.benchmarking.closed_forms import CLOSED_FORMS
from pcnclaws.benchmarking.context import BenchmarkContext, Checkpointed
from pcnclaws.benchmarking.convergence import orders_table, reference_errors
from pcnclaws.benchmarking.floor_scenes import FLOOR_SCENES, NODES_STEP, FloorScene
from pcnclaws.benchmarking.free_motions import FreeMotion
from pcnclaws.benchmarking.run_time_vs_error_report import draw, tables
from pcnclaws.benchmarking.timed_runs import Resolution, cost_of_run, timed_run
from pcnclaws.errors import SimulationDiverged, UserError
from pcnclaws.laws.materials import MATERIALS, Laws, material_named
from pcnclaws.laws.neural import build_neural_laws

__all__ = ["PRESETS", "draw", "run", "tables"]

NAME = "run_time_vs_error"
LAWS = ("analytic", "neural")
PROBLEMS = (*FLOOR_SCENES, *CLOSED_FORMS)
ELASTIC = "elasticity"
# The settings of simulation=fast|balanced|accurate, which name the time step and the particles of a cube instead.
PRESETS = {
    "fast": Resolution(20, 1, 2.0),
    "balanced": Resolution(30, 1, 1.5),
    "accurate": Resolution(40, 1, 1.25),
}


class Trial(NamedTuple):
    """One run to make."""

    problem: str
    material: str
    law: str
    resolution: Resolution

    @property
    def series(self) -> tuple[str, str, str]:
        """What the trial shares with all others that it is compared with."""
        return self.problem, self.material, self.law

    @property
    def name(self) -> str:
        """In words, for the progress and the stored rows."""
        return f"{', '.join(self.series)}: {self.resolution.name}"

    @property
    def scenario(self) -> FloorScene | FreeMotion:
        """What is simulated."""
        if self.problem in FLOOR_SCENES:
            return FLOOR_SCENES[self.problem](self.material)
        return FreeMotion(self.problem, CLOSED_FORMS[self.problem])


def run(options: Mapping[str, Any], context: BenchmarkContext) -> dict[str, Any]:
    """Run time and error of every setting.

    {"rows": [{"problem", "material", "law", settings, cost, "error", ...}], "references", "orders", "presets",
    "neural_laws"}; the errors of the floor scenes are in units of the body's size, the others relative to the
    displacement; null for a run that diverged
    """
    trials, finer = _trials(options)
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
        "presets": {name: asdict(resolution) for name, resolution in _presets(options).items()},
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


def _trials(options: Mapping[str, Any]) -> tuple[list[Trial], list[Trial]]:
    """The runs to make, and before them those that they are compared with; UserError for a wrong option."""
    resolutions, finest = _resolutions(options), _finest(options)
    floor = list(dict.fromkeys((*resolutions, *_presets(options).values())))
    free = list(dict.fromkeys((*resolutions, *(replace(one, precision="float64") for one in resolutions))))
    trials, finer = [], []
    materials, laws = names(options, "materials", MATERIALS), names(options, "laws", LAWS)
    for material, law, problem in product(materials, laws, names(options, "problems", PROBLEMS)):
        if problem in FLOOR_SCENES:
            finer.append(Trial(problem, material, law, finest))
            trials += [Trial(problem, material, law, resolution) for resolution in floor]
        elif material == ELASTIC:
            trials += [Trial(problem, material, law, resolution) for resolution in free]
    return trials, finer


def _resolutions(options: Mapping[str, Any]) -> list[Resolution]:
    """Every grid, particle density and time step; at some grids also other precisions, implementations, no skips."""
    backend, per_cell = _backend(options), wholes(options, "per_cell", most=4)
    factors = numbers(options, "time_factors", 0.0)
    found = [
        Resolution(*one, backend=backend)
        for one in product(_nodes(options["grid_nodes"], "grid_nodes"), per_cell, factors)
    ]
    for one in product(_nodes(options["compare_at"], "compare_at"), per_cell):
        same = Resolution(*one, 1.0, backend=backend)
        found += [replace(same, precision="float64"), replace(same, skips=False), replace(same, backend="torch")]
    return list(dict.fromkeys(found))


def _finest(options: Mapping[str, Any]) -> Resolution:
    (nodes,) = _nodes([options["reference_nodes"]], "reference_nodes")
    (factor,) = numbers({"reference_factor": [options["reference_factor"]]}, "reference_factor", 0.0)
    return Resolution(nodes, max(wholes(options, "per_cell", most=4)), factor, backend=_backend(options))


def _presets(options: Mapping[str, Any]) -> dict[str, Resolution]:
    chosen = PRESETS if options["presets"] else {}
    return {name: replace(resolution, backend=_backend(options)) for name, resolution in chosen.items()}


def _backend(options: Mapping[str, Any]) -> str:
    return names({"backend": [options["backend"]]}, "backend", BACKENDS)[0]


def _nodes(values: list[int], name: str) -> list[int]:
    for value in values:
        if value < NODES_STEP or value % NODES_STEP:
            raise UserError(f"problem.{name}: {value} is not accepted; accepted: multiples of {NODES_STEP}")
    return values


def _laws(options: Mapping[str, Any], context: BenchmarkContext, trials: list[Trial]) -> dict[tuple[str, str], Laws]:
    """Laws by material and kind; the neural ones of problem.law, or untrained ones of the seed."""
    found: dict[tuple[str, str], Laws] = {}
    for material, law in dict.fromkeys((trial.material, trial.law) for trial in trials):
        known = material_named(material)
        if law == "analytic" or options["law"] is not None:
            found[material, law] = context.laws(law if law == "analytic" else str(options["law"]), known)
        else:
            torch.manual_seed(context.seed)
            found[material, law] = build_neural_laws(known, NEURAL_MODEL)
    return found
