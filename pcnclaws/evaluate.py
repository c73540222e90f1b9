"""Evaluates a law: python -m pcnclaws.evaluate material=sand law=analytic trajectories=x.h5 output=metrics.json."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from omegaconf import DictConfig
from rich.console import Console
from rich.progress import Progress

from pcnclaws import launcher
from pcnclaws.configuration import (
    device_from,
    material_from,
    output_file,
    precision_from,
    skips_from,
    use_processor,
)
from pcnclaws.data.hdf5 import read_scenes
from pcnclaws.data.records import SceneRecord
from pcnclaws.data.scenes import start_of
from pcnclaws.errors import SimulationDiverged, UserError
from pcnclaws.evaluation.builtin import builtin_starts, paper_errors, steps_of_truth, true_records
from pcnclaws.evaluation.gallery import leave_pictures
from pcnclaws.evaluation.provenance import provenance
from pcnclaws.evaluation.report import metrics, results_table, write_metrics
from pcnclaws.evaluation.tasks import (
    SceneResult,
    evaluate_records,
    in_automatic_time_step,
    require_material,
    steps_to_run,
)
from pcnclaws.laws.materials import Material
from pcnclaws.runs import laws_for
from pcnclaws.time_step import largest_speed, scene_cfl, stable_cfl, time_step_limit

# Width of the table where the output is not a terminal.
PLAIN_WIDTH = 120


def evaluate(config: DictConfig) -> None:
    """Writes the errors of the configured law on the configured task to `output`, and pictures beside it."""
    output = output_file(config)
    use_processor(config)
    material = material_from(config)
    results = _results(config, material)
    _print_table(config, results, material)
    if config.picture:
        for path in leave_pictures(results, output.parent, output.stem):
            print(f"wrote {path}")
    source = {
        "material": material.name,
        "law": str(config.law),
        "task": str(config.task.name),
        "trajectories": config.trajectories,
    }
    origin = provenance(config.seed, device_from(config)) | {"precision": config.precision}
    write_metrics(output, source | metrics(results) | {"provenance": origin})
    print(f"wrote {output}")


def _results(config: DictConfig, material: Material) -> list[SceneResult]:
    device, dtype, skips = device_from(config), precision_from(config), skips_from(config)
    records = _file_records(config, material)
    starts = builtin_starts(config.task.name, material) if records is None else []
    laws = laws_for(str(config.law), material, [scene.parameters for scene in records or starts])
    if records is None:
        with _progress("simulating the truth", steps_of_truth(material)) as advance:
            records = _in_time_step(config, true_records(starts, material, device, advance, skips))
    try:
        with _progress(f"simulating with law={config.law}", steps_to_run(records)) as advance:
            return evaluate_records(records, laws, dtype, device, advance, skips)
    except SimulationDiverged as error:
        failed = next((record for record in records if f"scene '{record.name}'" in str(error)), records[0])
        advice = f"time_step={failed.settings.time_step:g}, stable: {_limit(failed)}"
        raise SimulationDiverged(f"{error}; {advice}") from error


def _file_records(config: DictConfig, material: Material) -> list[SceneRecord] | None:
    """The scenes of `trajectories=`, each one fit to be evaluated; None for a built-in task."""
    path = config.trajectories
    if config.task.name != "file":
        if path is not None:
            raise UserError(f"trajectories={path} does not go with task={config.task.name}; accepted: one of the two")
        return None
    if not isinstance(path, str) or not path:
        raise UserError(
            f"trajectories={path or 'null'} is not accepted; accepted: the path of a trajectory file, or task=unseen"
        )
    records = read_scenes(path)
    require_material(records, material)
    records = _in_time_step(config, records)
    for record in records:
        _require_stable(record)
    return records


def _in_time_step(config: DictConfig, records: list[SceneRecord]) -> list[SceneRecord]:
    """The records in the time step of `simulation.time_step`: their own, or the automatic one."""
    wanted = config.simulation.time_step
    if wanted not in (None, "auto"):
        raise UserError(f"simulation.time_step={wanted} is not accepted; accepted: auto, or null for the file's own")
    return [in_automatic_time_step(record) for record in records] if wanted else records


def _require_stable(record: SceneRecord) -> None:
    """Refuses a record that says too little for a simulation, or whose time step no simulation survives."""
    start = start_of(record)
    speed = largest_speed(start.position, start.velocity, start.settings.gravity, start.settings.wall_distance)
    stable = stable_cfl(start.material, start.parameters["poissons_ratio"])
    if scene_cfl(start.settings, start.parameters, speed) > stable:
        raise UserError(
            f"{record.label}: time_step={start.settings.time_step:g} is unstable; accepted: {_limit(record)}"
        )


def _limit(record: SceneRecord) -> str:
    start = start_of(record)
    speed = largest_speed(start.position, start.velocity, start.settings.gravity, start.settings.wall_distance)
    return time_step_limit(start.settings, start.parameters, speed, start.material)


@contextmanager
def _progress(what: str, steps: int) -> Iterator[Callable[[int], None]]:
    """A progress bar with the time left, on stderr, gone when done."""
    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(what, total=steps)
        yield lambda done: progress.advance(task, done)


def _print_table(config: DictConfig, results: Sequence[SceneResult], material: Material) -> None:
    source = Path(config.trajectories).name if config.trajectories else f"task {config.task.name}"
    published = paper_errors(material) if config.task.name == "unseen" else {}
    console = Console()
    if not console.is_terminal:
        console = Console(width=PLAIN_WIDTH)
    console.print(results_table(results, f"{material.name}, law {config.law}, {source}", published=published))


def main() -> None:
    """The command."""
    launcher.main(evaluate, "evaluate")


if __name__ == "__main__":
    main()
