"""Results of a training run: errors before and after on unseen objects, as table, JSON and pictures."""

import time
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import Progress

from pcnclaws.commands.runs import METRICS
from pcnclaws.errors import SimulationDiverged
from pcnclaws.evaluation.builtin import paper_errors
from pcnclaws.evaluation.divergence import survivors
from pcnclaws.evaluation.gallery import leave_pictures
from pcnclaws.evaluation.report import Outcomes, metrics, results_table, survived, write_metrics
from pcnclaws.evaluation.tasks import SceneResult, evaluate_records, steps_to_run
from pcnclaws.guards import counts
from pcnclaws.laws.materials import material_named
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.provenance import provenance
from pcnclaws.rendering.curves import LossCurve, loss_curve
from pcnclaws.simulation.execution import Execution
from pcnclaws.simulation.motion import SceneSimulator
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.training.sources import TrainingScenes
from pcnclaws.training.trainer import FitResult

# Length of the motions behind the paper's numbers [steps].
PAPER_STEPS = 500


@dataclass(frozen=True)
class Report:
    """A finished training and what it started from.

    notes      plain values kept with the results
    started    time.monotonic() when the command began
    execution  of the simulations of the test
    """

    folder: Path
    scenes: TrainingScenes
    fitted: FitResult
    notes: dict[str, Any]
    untrained: SceneSimulator
    trained: SceneSimulator
    started: float
    execution: Execution


def write_report(report: Report, seed: int, pictures: bool, console: Console) -> None:
    """Tests the model before and after training, prints the table, and writes metrics.json and the pictures."""
    after = _after(report, console)
    nothing_fitted = report.notes["iterations"] == 0
    before = survived(after) if nothing_fitted else _results_or_none(report, console)
    published = _published(report.scenes.test)
    start = "positions only" if report.notes["positions_only"] else "segments from keyframes"
    title = f"{report.notes['material']}, {report.notes['regime']}, {start}: {len(after)} scenes"
    console.print(results_table(after, title, before, published))
    for warning in (*_warning(report), *_contradictions(report)):
        console.print(warning)
    for path in _pictures(report, survived(after), before) if pictures else ():
        console.print(f"wrote {path}")
    execution = report.execution
    origin = provenance(seed, execution.device) | {"precision": str(execution.dtype).removeprefix("torch.")}
    # of this command alone: data that was there and iterations before an interruption are not in it
    seconds = round(time.monotonic() - report.started, 1)
    values = _metrics(report, after, before, published) | {"seconds": seconds, "guards": counts()}
    values |= {"provenance": origin}
    write_metrics(report.folder / METRICS, values)
    console.print(f"wrote {report.folder / METRICS}")
    console.print(f"use it with law={report.folder}")


def against_untrained(trained: float, untrained: float | None) -> dict[str, Any]:
    """What the results keep of the checks of the trained and the untrained model.

    trained, untrained  mean MSE of the check scenes [m^2], infinite if the model diverges; None: nothing was trained
    """
    better = None if untrained is None else trained < untrained
    return {"validation_mse_before_training": untrained, "better_than_untrained": better}


def _warning(report: Report) -> list[str]:
    """One line where the training made nothing better."""
    if report.notes.get("better_than_untrained") is not False:
        return []
    before, after = report.notes["validation_mse_before_training"], report.notes["validation_mse"]
    if report.notes.get("init") is not None:
        return [
            f"warning: training made nothing better than the {before:.2e} m² of the law it began with, which is kept"
        ]
    return [f"warning: training made nothing better: the checks give {after:.2e} m² after it, {before:.2e} m² before"]


def _contradictions(report: Report) -> list[str]:
    """One line a scene that does not fit to the others."""
    return [
        f"warning: scene '{name}' is explained {ratio:.0f} times worse than the median scene (relative squared error): "
        "are its parameters, units and walls right, and those of scenes like it? "
        "training.loss=robust learns from the others"
        for name, ratio in report.notes.get("contradicting_scenes", {}).items()
    ]


def _after(report: Report, console: Console) -> Outcomes:
    """What the trained model makes of the test; a scene that diverges is a result, and no reason to lose the others."""
    model, records = report.trained, report.scenes.test
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        advance = partial(progress.advance, progress.add_task("test after training", total=len(records)))
        return survivors(records, lambda some: evaluate_records(some, model, report.execution), advance)


def _results(report: Report, model: SceneSimulator, what: str, console: Console) -> list[SceneResult]:
    records = report.scenes.test
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(what, total=steps_to_run(records))
        advance = partial(progress.advance, task)
        return evaluate_records(records, model, replace(report.execution, progress=advance))


def _results_or_none(report: Report, console: Console) -> list[SceneResult]:
    """The same numbers before training: what the structure of the law alone gives; none if that diverges."""
    try:
        return _results(report, report.untrained, "test before training", console)
    except SimulationDiverged as divergence:
        console.print(f"before training: {divergence}")
        return []


def _published(records: list[SceneRecord]) -> dict[str, float]:
    """The paper's errors of the test scenes that are the paper's, in its setting."""
    known = paper_errors(material_named(records[0].material))
    return {
        record.name: known[record.name]
        for record in records
        if record.name in known
        and record.settings == SimulationSettings()
        and int(record.frame_steps()[-1]) == PAPER_STEPS
    }


def _metrics(report: Report, after: Outcomes, before: list[SceneResult], published: dict[str, float]) -> dict[str, Any]:
    history = report.fitted.history
    values = metrics(after)
    earlier = {result.name: result.mse for result in before}
    for scene in values["scenes"]:
        scene["mse_before_training"] = earlier.get(scene["name"])
        scene["mse_paper"] = published.get(scene["name"])
    return values | {
        "mse_before_training": metrics(before)["mse"] if before else None,
        "training": report.notes,
        "history": {"loss": history.loss, "check_iteration": history.check_iteration, "check_mse": history.check_mse},
    }


def _pictures(report: Report, after: list[SceneResult], before: list[SceneResult]) -> list[Path]:
    history = report.fitted.history
    others = leave_pictures(after, report.folder, "predicted", before) if after else []
    if not history.loss:
        return others
    loss = loss_curve(
        LossCurve(range(1, len(history.loss) + 1), history.loss),
        report.folder / "loss.png",
        LossCurve(history.check_iteration, history.check_mse),
    )
    return [loss, *others]
