"""Which material is a body of, with which parameters: the reference objects, explained by the law of each material."""

import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from benchmarks.charts import COLOURS, chart, decorate, save, table_of
from benchmarks.checks import names, whole
from benchmarks.context import BenchmarkContext, Checkpointed
from pcnclaws.commands.runs import shipped_folder
from pcnclaws.data.observation import Observation
from pcnclaws.data.observation_files import from_record
from pcnclaws.data.sampling import DataSetPlan, planned_scenes
from pcnclaws.errors import UserError
from pcnclaws.estimation.goodness_of_fit import fit_of
from pcnclaws.estimation.law_error import known_law_error
from pcnclaws.estimation.levenberg_marquardt import LevenbergMarquardt
from pcnclaws.estimation.problem import EstimationProblem, Linearisation
from pcnclaws.estimation.screening import screened_start, stable_start
from pcnclaws.estimation.start_motion import with_first_motion
from pcnclaws.estimation.transforms import transform_of
from pcnclaws.estimation.uncertainty import uncertainty
from pcnclaws.estimation.unknowns import components_of, make_unknowns
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.materials import Material, material_named
from pcnclaws.laws.parameters import PARAMETERS
from pcnclaws.simulation.execution import Execution
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.records import SceneRecord

KINDS = ("elasticity", "plasticine", "sand")
# Of noisy observations: so many markers on the surface, of which a share is not seen in a frame.
MARKERS, MISSING = 100, 0.1


def run(options: Mapping[str, Any], context: BenchmarkContext) -> dict[str, Any]:
    """The residual of each object under each material, and the parameters found.

    {"rows": [{"object", "kind", "truth", "noise", "explained": {material: {"mse", "residual", "scatter", "fitted",
    "parameters", "intervals", "iterations", "seconds"}}}]}: mse [m^2] of a coordinate; residual and scatter [m]
    """
    kinds, steps, every = names(options, "kinds", KINDS), whole(options, "steps"), whole(options, "every")
    levels = [_noise(value) for value in options["noise"]]
    for name, least in (("iterations", 1), ("screening", 0)):
        whole(options, name, least)
    done = Checkpointed.load(context.folder, "which_material", {"options": dict(options), "seed": context.seed})
    starts = {kind: planned_scenes(DataSetPlan(material_named(kind)))["test"] for kind in kinds}
    orders = [(level, kind, number) for level in levels for number in range(3) for kind in kinds]
    recorded: dict[tuple[str, int], SceneRecord] = {}
    rows = []
    for count, (level, kind, number) in enumerate(orders):
        start = starts[kind][number]
        context.advance(count, len(orders), f"{start.name}, noise {level:g} m")
        explained = {}
        for asked in kinds:

            def made(asked: str = asked, key: tuple[str, int] = (kind, number), level: float = level) -> dict[str, Any]:
                if key not in recorded:
                    laws = analytic_laws(material_named(key[0]))
                    recorded[key] = simulate_records([starts[key[0]][key[1]]], laws, FramePlan(steps, every))[0]
                seen = seen_markers(recorded[key], level, np.random.default_rng((context.seed, key[1])))
                return _explained(seen, material_named(asked), options, context)

            explained[asked] = done.row(f"{start.name} {level} {asked}", made)
        row = {"object": start.name, "kind": kind, "truth": dict(start.parameters), "noise": level}
        rows.append(row | {"explained": explained})
    context.advance(len(orders), len(orders), "done")
    return {"rows": rows}


def answer(row: Mapping[str, Any]) -> str:
    """The material that leaves the least."""
    return min(row["explained"], key=lambda kind: row["explained"][kind]["mse"])


def tables(document: Mapping[str, Any]) -> list[Table]:
    """The residuals [mm], a line an object."""
    table = table_of("which material", "object", "noise [mm]", *(f"as {kind} [mm]" for kind in KINDS), "answer")
    for row in document["results"]["rows"]:
        left = (f"{1e3 * row['explained'][kind]['mse'] ** 0.5:.3g}" for kind in KINDS if kind in row["explained"])
        table.add_row(row["object"], f"{1e3 * row['noise']:g}", *left, answer(row))
    return [table]


def draw(document: Mapping[str, Any], folder: Path) -> list[Path]:
    """The residual of each object under each material."""
    rows = document["results"]["rows"]
    figure, axis = chart()
    for number, kind in enumerate(KINDS):
        left = [1e3 * row["explained"][kind]["mse"] ** 0.5 for row in rows if kind in row["explained"]]
        axis.plot(range(len(left)), left, "o", color=COLOURS[number], label=f"as {kind}")
    axis.set_yscale("log")
    axis.set_xticks(range(len(rows)), [row["kind"] for row in rows], rotation=90, fontsize=6)
    decorate(axis, "object by its true material", "residual of a coordinate [mm]")
    axis.legend(fontsize=7, frameon=False)
    return [save(figure, folder / f"{document['problem']}.png")]


def _explained(
    seen: Observation, material: Material, options: Mapping[str, Any], context: BenchmarkContext
) -> dict[str, Any]:
    """What the law of a material makes of the motion at best."""
    began, observation = time.monotonic(), replace(seen, material=material.name)
    parts = components_of("uniform", observation.position, observation.spacing)
    moves = observation.initial_velocity is None
    unknowns = make_unknowns(material.parameter_names, {}, parts, parts, motion=moves, time_offset=False)
    problem = EstimationProblem(context.laws("pretrained", material), observation, unknowns, Execution())
    inside = {name: transform_of(PARAMETERS[name]).inside(value) for name, value in material.defaults.items()}
    values = np.array([inside.get(unknown.name, 0.0) for unknown in unknowns.sought])
    values = with_first_motion(observation, unknowns, values) if moves else values
    guess = stable_start(problem, unknowns.coordinates(values.tolist()))
    u = screened_start(problem, guess, int(options["screening"]), context.seed)[0]
    u, here, count = searched(problem, u, int(options["iterations"]))
    found = uncertainty(here, unknowns, u, known_law_error(shipped_folder(material)), None)
    fit = fit_of(problem, u, found, None)
    own = [one for one in found.estimates if one.label in PARAMETERS]
    return {
        "mse": here.mse,
        "residual": fit.residual,
        "scatter": None if fit.scatter is None else fit.scatter.size,
        "fitted": fit.fitted,
        "parameters": {one.label: one.value if one.identifiable else None for one in own},
        "intervals": {one.label: list(one.interval) for one in own},
        "iterations": count,
        "seconds": time.monotonic() - began,
    }


def searched(problem: EstimationProblem, u: np.ndarray, most: int) -> tuple[np.ndarray, Linearisation, int]:
    """Coordinates and linearisation after a search of at most so many steps, and how many it took."""
    search, here = LevenbergMarquardt(), problem.linearise(u)
    for count in range(most):
        step = search.step(here, problem.unknowns.reach(u))
        there = problem.linearise(u + step)
        if search.judge(here.mse, there.mse, step):
            u, here = u + step, there
        if search.done:
            return u, here, count + 1
    return u, here, most


def seen_markers(record: SceneRecord, noise: float, random: np.random.Generator) -> Observation:
    """All particles of known start velocity; with noise, some on the surface, with gaps, whose start is not known."""
    whole_body = from_record(record)
    if noise == 0.0:
        return whole_body
    position = whole_body.position
    outside = (np.isclose(position, position.min(0)) | np.isclose(position, position.max(0))).any(1)
    chosen = np.sort(random.choice(np.flatnonzero(outside), MARKERS, replace=False))
    target = whole_body.target[:, chosen] + noise * random.normal(size=(len(whole_body.time), MARKERS, 3))
    target[1:][random.random(target.shape[:2])[1:] < MISSING] = np.nan
    return replace(
        whole_body,
        target=target,
        particle=whole_body.particle[chosen],
        weight=whole_body.weight[chosen],
        initial_velocity=None,
        spins_have_gradient=False,
    )


def _noise(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value < 1.0:
        raise UserError(f"problem.noise: {value} is not accepted; accepted: numbers of metres from 0 to below 1")
    return float(value)
