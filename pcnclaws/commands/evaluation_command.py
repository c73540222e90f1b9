"""Evaluation of a law on a file or a built-in task, from its records to the result file and its pictures."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from rich.console import Console

from pcnclaws.commands.configuration import (
    device_from,
    execution_from,
    use_processor,
)
from pcnclaws.commands.outputs import RESULT, output_file
from pcnclaws.commands.progress_bar import progress_bar
from pcnclaws.commands.runs import model_for
from pcnclaws.commands.typed_configs import EvaluateConfig
from pcnclaws.data.first_motion import name_contradictions
from pcnclaws.data.trajectory_files import read_trajectories
from pcnclaws.data.units import check_record
from pcnclaws.errors import SimulationDiverged, UserError
from pcnclaws.evaluation.builtin import builtin_task, paper_errors, true_records
from pcnclaws.evaluation.divergence import DivergedScene, survivors
from pcnclaws.evaluation.floor import floor
from pcnclaws.evaluation.frames import in_automatic_time_step
from pcnclaws.evaluation.gallery import leave_map, leave_pictures, leave_sheet
from pcnclaws.evaluation.report import Outcomes, metrics, results_table, survived, write_metrics
from pcnclaws.evaluation.tasks import evaluate_records, require_material, steps_to_run
from pcnclaws.guards import counts
from pcnclaws.laws.materials import Material, material_named
from pcnclaws.provenance import provenance
from pcnclaws.simulation.motion import SceneSimulator
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.simulation.scenes import start_of
from pcnclaws.simulation.time_step import stability_of

FLOOR_WORDS = {"float64": "analytic law in double precision", "half_step": "and with half the time step"}
# Width of the table where the output is not a terminal.
PLAIN_WIDTH = 120
# The task whose scenes are a map of parameters: shown as one, and too many for a curve of each.
MAP = "outside_range"


def evaluate(config: EvaluateConfig) -> Mapping[str, float | None]:
    """Writes the errors of the configured law on the configured task to `output`, and pictures beside it.

    returns  the means of the errors
    """
    output = output_file(config.output, {"trajectories": config.trajectories}, *RESULT)
    use_processor(config)
    material = material_named(config.material.name)
    outcomes, floors = _on_file(config, material) if config.task.name == "file" else _on_task(config, material)
    _print_table(config, outcomes, material)
    if floors:
        print(f"floor: {', '.join(f'{FLOOR_WORDS[name]} {_in_words(mse)}' for name, mse in floors.items())}")
    for path in _pictures(config, outcomes, material, output) if config.picture else ():
        print(f"wrote {path}")
    source = {
        "material": material.name,
        "law": config.law,
        "task": config.task.name,
        "scene": _scene(config),
        "trajectories": config.trajectories,
    }
    origin = provenance(config.seed, device_from(config.device)) | {"precision": config.precision}
    values: dict[str, Any] = metrics(outcomes, curves=config.task.name != MAP) | ({"floor": floors} if floors else {})
    write_metrics(output, source | values | {"guards": counts(), "provenance": origin})
    print(f"wrote {output}")
    return {
        "MSE [m^2]": values["mse"],
        "RMS [% of size]": values["rms_percent"],
        "stress error": values["stress_error"],
    }


def _on_file(config: EvaluateConfig, material: Material) -> tuple[Outcomes, dict[str, float | None]]:
    """What becomes of the scenes of a file; no floor, whose truth would have to be analytic."""
    records = _file_records(config, material)
    model = model_for(config.law, material, [record.parameters for record in records])
    return _simulated(config, records, model, config.may_diverge), {}


def _on_task(config: EvaluateConfig, material: Material) -> tuple[Outcomes, dict[str, float | None]]:
    """What becomes of the scenes of a built-in task, and the floor of their errors."""
    if config.trajectories is not None:
        raise UserError(
            f"trajectories={config.trajectories} does not go with task={config.task.name}; accepted: one of the two"
        )
    task = builtin_task(config.task.name, material, _scene(config))
    # that a map goes outside the training data needs no warning
    model = model_for(config.law, material, [] if task.may_diverge else [start.parameters for start in task.starts])
    execution = execution_from(config)
    with progress_bar("simulating the truth", task.work) as advance:
        truth = true_records(task, material, replace(execution, progress=advance))
    records = [scene for scene in truth if isinstance(scene, SceneRecord)]
    outcomes = [scene for scene in truth if isinstance(scene, DivergedScene)]
    if records:
        may_diverge = task.may_diverge or config.may_diverge
        outcomes = [*_simulated(config, _in_time_step(config, records), model, may_diverge), *outcomes]
    if not config.floor or not records:
        return outcomes, {}
    with progress_bar("simulating the floor", 2 * len(records)) as advance:
        return outcomes, floor(records, replace(execution, progress=advance))


def _simulated(
    config: EvaluateConfig, records: list[SceneRecord], model: SceneSimulator, may_diverge: bool = False
) -> Outcomes:
    """The records beside what the model makes of them. may_diverge: a scene that diverges is a result, too."""
    what, execution = f"simulating with law={config.law}", execution_from(config)
    if may_diverge:
        with progress_bar(what, len(records)) as advance:
            return survivors(records, lambda some: evaluate_records(some, model, execution), advance)
    try:
        with progress_bar(what, steps_to_run(records)) as advance:
            return evaluate_records(records, model, replace(execution, progress=advance))
    except SimulationDiverged as error:
        failed = next((record for record in records if f"scene '{record.name}'" in str(error)), records[0])
        raise SimulationDiverged(f"{error}; {stability_of(start_of(failed)).advice(error)}") from error


def _pictures(config: EvaluateConfig, outcomes: Outcomes, material: Material, output: Path) -> list[Path]:
    if config.task.name == "file":
        return leave_pictures(survived(outcomes), output.parent, output.stem)
    task = " ".join(filter(None, (config.task.name.replace("_", " "), _scene(config))))
    title = f"{material.name.replace('_', '-')}, law {Path(config.law).name}, {task}"
    if config.task.name == MAP:
        return leave_map(outcomes, material, title, output.parent, output.stem)
    results = survived(outcomes)
    return leave_sheet(results, title, output.parent, output.stem) if results else []


def _scene(config: EvaluateConfig) -> str | None:
    """The training scene of `task.scene=`; None without one, and for tasks that have none."""
    scene = config.task.scene
    return None if scene is None else str(scene)


def _file_records(config: EvaluateConfig, material: Material) -> list[SceneRecord]:
    """The scenes of `trajectories=`, each one fit to be evaluated."""
    path = config.trajectories
    if not isinstance(path, str) or not path:
        raise UserError(
            f"trajectories={path or 'null'} is not accepted; accepted: the path of a trajectory file, or task=unseen"
        )
    records = read_trajectories(path, material.name)
    require_material(records, material)
    records = _in_time_step(config, records)
    for record in records:
        _require_stable(record)
        check_record(record)
    name_contradictions(records)
    return records


def _in_time_step(config: EvaluateConfig, records: list[SceneRecord]) -> list[SceneRecord]:
    """The records in the time step of `simulation.time_step`: their own, or the automatic one."""
    wanted = config.simulation.time_step
    if wanted not in (None, "auto"):
        raise UserError(f"simulation.time_step={wanted} is not accepted; accepted: auto, or null for the file's own")
    return [in_automatic_time_step(record) for record in records] if wanted else records


def _require_stable(record: SceneRecord) -> None:
    """Refuses a record that says too little for a simulation, or whose time step no simulation survives."""
    stability = stability_of(start_of(record))
    if not stability.is_stable:
        step = record.settings.time_step
        raise UserError(f"{record.label}: time_step={step:g} is unstable; accepted: {stability.limit}")


def _print_table(config: EvaluateConfig, outcomes: Outcomes, material: Material) -> None:
    source = Path(config.trajectories).name if config.trajectories else f"task {config.task.name}"
    published = paper_errors(material) if config.task.name == "unseen" else {}
    console = Console()
    if not console.is_terminal:
        console = Console(width=PLAIN_WIDTH)
    console.print(results_table(outcomes, f"{material.name}, law {config.law}, {source}", published=published))


def _in_words(mse: float | None) -> str:
    return "diverged" if mse is None else f"{mse:.1e} m^2"
