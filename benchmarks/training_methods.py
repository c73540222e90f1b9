"""Adam and the Kalman filter on the same segments: error on unseen parameters against CPU time, and over seeds."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.table import Table

from benchmarks.charts import COLOURS, chart, decorate, save, table_of
from benchmarks.checks import names, whole, wholes
from benchmarks.context import BenchmarkContext, Checkpointed
from benchmarks.laws_from_motions import Motions, Recipe, recorded_motions, trained
from pcnclaws.laws.materials import Material, material_named
from pcnclaws.training.trainer import quiet_lightning

# By method, in words.
METHODS = {"adam": "Adam (`training=short`)", "kalman": "Kalman filter (`training=kalman`)"}


def run(options: Mapping[str, Any], context: BenchmarkContext) -> dict[str, Any]:
    """Errors on each material's reference objects after each training.

    {"rows": [{"material", "method", "iterations", "seed", "cpu_seconds", "checked", "unseen", "scenes"}]}; MSE [m^2],
    None where a motion diverges; seconds of the processor in the training and its only check, of two motions
    """
    quiet_lightning()
    materials = [material_named(name, "problem.materials") for name in options["materials"]]
    methods = names(options, "methods", METHODS)
    lengths = {method: wholes(options["iterations"], method) for method in METHODS}
    seeds = {method: whole(options["seeds"], method) for method in METHODS}
    cases = [
        (material, method, length, seed)
        for material in materials
        for method in methods
        for length in lengths[method]
        for seed in (range(seeds[method]) if length == max(lengths[method]) else (0,))
    ]
    scenes = {name: whole(options, name) for name in ("scenes", "steps")}
    done = Checkpointed.load(context.folder, "training_methods", scenes | {"seed": context.seed})
    motions: dict[str, Motions] = {}
    rows = []
    for number, (material, method, length, seed) in enumerate(cases):
        told = f"{material.name}, {length} iterations of {method}, seed {seed}"
        context.advance(number, len(cases), told)

        def made(case: tuple[Material, str, int, int] = cases[number]) -> dict[str, Any]:
            material, method, length, seed = case
            if material.name not in motions:
                motions[material.name] = recorded_motions(material, scenes["scenes"], scenes["steps"], context)
            recipe = Recipe(method=method, seed=seed, checks=1)
            found = trained(material, motions[material.name], recipe, length, context)
            return {
                "cpu_seconds": found.cpu_seconds,
                "checked": found.checked,
                "unseen": found.mean,
                "scenes": found.errors,
            }

        known = {"material": material.name, "method": method, "iterations": length, "seed": seed}
        rows.append(known | done.row(told, made))
    context.advance(len(cases), len(cases), "done")
    return {"rows": rows}


def tables(document: Mapping[str, Any]) -> list[Table]:
    """The errors, a line a training."""
    columns = ("material", "method", "iterations", "seed", "CPU seconds", "validation", "unseen, MSE [m²]")
    table = table_of("trainings by method", *columns)
    for row in document["results"]["rows"]:
        known = (row["material"], row["method"], str(row["iterations"]), str(row["seed"]))
        table.add_row(*known, f"{row['cpu_seconds']:.0f}", _error(row["checked"]), _error(row["unseen"]))
    return [table]


def draw(document: Mapping[str, Any], folder: Path) -> list[Path]:
    """Error against CPU time: a curve through seed 0 of each material and method, and a dot for each further seed."""
    rows = [row for row in document["results"]["rows"] if row["unseen"]]
    figure, axis = chart()
    for material, style in zip(dict.fromkeys(row["material"] for row in rows), ("-", "--", ":"), strict=False):
        for colour, method in zip(COLOURS, METHODS, strict=False):
            of_one = [row for row in rows if (row["material"], row["method"]) == (material, method)]
            if of_one:
                curve = sorted((row["cpu_seconds"], row["unseen"]) for row in of_one if row["seed"] == 0)
                axis.plot(*zip(*curve, strict=True), f"o{style}", color=colour, label=f"{material}, {method}")
                others = [(row["cpu_seconds"], row["unseen"]) for row in of_one if row["seed"]]
                if others:
                    axis.plot(*zip(*others, strict=True), "o", color=colour, markersize=2.5)
    axis.set_yscale("log")
    axis.legend(fontsize=7)
    decorate(axis, "processor time of the training [s]", "error on unseen parameters, MSE [m²]")
    return [save(figure, folder / f"{document['problem']}.png")]


def _error(value: float | None) -> str:
    return "diverged" if value is None else f"{value:.1e}"
