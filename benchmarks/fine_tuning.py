"""A shipped law fine-tuned to few motions of another material, beside trainings from nothing on the same motions."""

import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import torch
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from benchmarks.charts import COLOURS, chart, decorate, save, table_of
from benchmarks.checks import names, whole, wholes
from benchmarks.context import BenchmarkContext, Checkpointed
from benchmarks.mohr_coulomb import MohrCoulomb
from benchmarks.own_material import MooneyRivlin
from pcnclaws.commands.models import build_model
from pcnclaws.commands.runs import load_run, shipped_folder
from pcnclaws.data.datamodule import TrajectoryDataModule
from pcnclaws.data.sampling import DataSetPlan, planned_scenes
from pcnclaws.data.segments import SegmentPlan
from pcnclaws.errors import SimulationDiverged
from pcnclaws.evaluation.tasks import evaluate_records
from pcnclaws.laws.analytic import Laws, analytic_laws
from pcnclaws.laws.elasticity import StVKHencky
from pcnclaws.laws.materials import Material, material_named
from pcnclaws.simulation.execution import Execution
from pcnclaws.simulation.motion import SceneSimulator
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.training.module import OptimiserSettings
from pcnclaws.training.multi_scene import MultiSceneModule
from pcnclaws.training.sources import show_deformations
from pcnclaws.training.trainer import fit, quiet_lightning
from pcnclaws.training.weights import model_weights, set_model_weights

# As in conf/training/keyframes.yaml, and in fine_tuning.yaml.
SEGMENTS, SEGMENT_LENGTH = 4, 20
OPTIMISER = OptimiserSettings(gradient_clip=10.0)
FINE_TUNING = OptimiserSettings(learning_rate=1e-2, gradient_clip=10.0)


class Pair(NamedTuple):
    """A material whose law ships, and the laws that the motions of the other one are of."""

    words: str
    ships: str
    other: Laws


PAIRS = {
    "mohr_coulomb": Pair("from sand to Mohr-Coulomb", "sand", Laws(StVKHencky(), MohrCoulomb())),
    "mooney_rivlin": Pair("from elasticity to Mooney-Rivlin", "elasticity", Laws(MooneyRivlin(), None)),
}


def run(options: Mapping[str, Any], context: BenchmarkContext) -> dict[str, Any]:
    """Errors on unseen parameters of the new and of the old material, before and after each training.

    {"rows": [{"pair", "words", "start", "iterations", "seconds", "trained_on", "unseen", "old"}]}; MSE [m^2], None
    where a motion diverges
    """
    orders = [
        (pair, start, count)
        for pair in names(options, "pairs", PAIRS)
        for start, counts in (
            ("shipped", [0, *wholes(options, "fine_tuning")]),
            ("nothing", wholes(options, "training")),
        )
        for count in counts
    ]
    scenes, steps = whole(options, "scenes"), whole(options, "steps")
    quiet_lightning()
    done = Checkpointed.load(context.folder, "fine_tuning", {"options": dict(options), "seed": context.seed})
    motions: dict[str, dict[str, list[SceneRecord]]] = {}
    rows = []
    for number, (pair, start, count) in enumerate(orders):
        context.advance(number, len(orders), f"{PAIRS[pair].words}, {count} iterations from {start}")

        def made(pair: str = pair, start: str = start, count: int = count) -> dict[str, Any]:
            if pair not in motions:
                motions[pair] = _motions(PAIRS[pair], scenes, steps, context)
            return _row(PAIRS[pair], motions[pair], start, count, context)

        row = done.row(f"{pair}, {start}, {count}", made)
        rows.append({"pair": pair, "words": PAIRS[pair].words, "start": start, "iterations": count, **row})
    context.advance(len(orders), len(orders), "done")
    return {"rows": rows}


def tables(document: Mapping[str, Any]) -> list[Table]:
    """The errors, a line a training."""
    table = table_of("few motions of another material", "", "start", "iterations", "seconds")
    for name in ("trained on", "unseen", "old material"):
        table.add_column(escape(f"{name} [m^2]"), justify="right")
    for row in document["results"]["rows"]:
        errors = ("diverged" if row[name] is None else f"{row[name]:.1e}" for name in ("trained_on", "unseen", "old"))
        table.add_row(row["words"], row["start"], str(row["iterations"]), f"{row['seconds']:.0f}", *errors)
    return [table]


def draw(document: Mapping[str, Any], folder: Path) -> list[Path]:
    """The error on unseen parameters over the iterations, from the shipped law and from nothing."""
    rows = document["results"]["rows"]
    figure, axis = chart()
    for number, pair in enumerate(dict.fromkeys(row["pair"] for row in rows)):
        for start, style in (("shipped", "o-"), ("nothing", "s:")):
            found = [row for row in rows if row["pair"] == pair and row["start"] == start and row["unseen"]]
            label = f"{found[0]['words']}, from {start}" if found else ""
            places = [max(row["iterations"], 1) for row in found]
            axis.plot(places, [row["unseen"] for row in found], style, color=COLOURS[number], label=label)
    decorate(axis, "iterations (0 is drawn at 1)", "error on unseen parameters, MSE [m²]")
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.legend(fontsize=7, frameon=False)
    return [save(figure, folder / f"{document['problem']}.png")]


def _motions(pair: Pair, scenes: int, steps: int, context: BenchmarkContext) -> dict[str, list[SceneRecord]]:
    """Motions of the other material to train on and unseen ones, and the reference objects of the shipped law's."""
    material = material_named(pair.ships)
    starts = planned_scenes(
        DataSetPlan(
            material,
            steps=steps,
            keyframe_every=SEGMENT_LENGTH,
            train_scenes=scenes,
            validation_scenes=3,
            seed=context.seed,
        )
    )
    frames, execution = FramePlan(steps, 5, SEGMENT_LENGTH), Execution(device=context.device)
    return {
        "train": simulate_records(starts["train"], pair.other, frames, execution),
        "unseen": simulate_records([*starts["validation"], *starts["test"]], pair.other, frames, execution),
        "old": simulate_records(starts["test"], analytic_laws(material), frames, execution),
    }


def _row(
    pair: Pair, motions: Mapping[str, Sequence[SceneRecord]], start: str, iterations: int, context: BenchmarkContext
) -> dict[str, Any]:
    material = material_named(pair.ships)
    model, began = _started(material, start, context), time.monotonic()
    failed = False
    if iterations:
        try:
            _train(model, motions["train"], iterations, start == "shipped", context)
        except SimulationDiverged:
            failed = True
    seconds = time.monotonic() - began
    errors = {
        name: None if failed else _error(model, motions[split])
        for name, split in (("trained_on", "train"), ("unseen", "unseen"), ("old", "old"))
    }
    return {"seconds": seconds, **errors}


def _started(material: Material, start: str, context: BenchmarkContext) -> SceneSimulator:
    """The model of the shipped law, with its weights or with those of the seed."""
    shipped = load_run(shipped_folder(material))
    torch.manual_seed(context.seed)
    model = build_model(material, shipped.config["model"])
    if start == "shipped":
        set_model_weights(model, model_weights(shipped.model), material.name)
    return model


def _train(
    model: SceneSimulator, records: Sequence[SceneRecord], iterations: int, beside: bool, context: BenchmarkContext
) -> None:
    laws = model.laws
    assert laws is not None  # noqa: S101
    show_deformations(laws.elasticity, records, beside)
    plan = SegmentPlan(iterations, SEGMENTS, first=SEGMENT_LENGTH, last=SEGMENT_LENGTH, seed=context.seed)
    segments = TrajectoryDataModule(records, records, plan, check_every=iterations)
    module = MultiSceneModule(laws, segments.dataset.settings, FINE_TUNING if beside else OPTIMISER, iterations)
    with tempfile.TemporaryDirectory() as folder:
        fit(module, segments, Path(folder), context.device, console=Console(quiet=True))


def _error(model: SceneSimulator, records: Sequence[SceneRecord]) -> float | None:
    try:
        results = evaluate_records(records, model)
    except SimulationDiverged:
        return None
    return sum(one.mse for one in results) / len(results)
