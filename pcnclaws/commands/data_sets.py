"""The generated data set that a configuration asks for, made where it is missing."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from omegaconf import DictConfig
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from pcnclaws.commands.configuration import (
    body_from,
    execution_from,
    material_from,
    precision_from,
    settings_from,
    whole_number,
)
from pcnclaws.commands.outputs import check_ending
from pcnclaws.data.generation import Progress as Report
from pcnclaws.data.generation import generate_data_set
from pcnclaws.data.sampling import DataSetPlan, planned_scenes
from pcnclaws.errors import UserError
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.simulation.scenes import SceneStart
from pcnclaws.simulation.time_step import automatic_time_step, check_time_step, largest_speed, scene_cfl, stable_cfl

log = logging.getLogger(__name__)


def plan_from(config: DictConfig) -> DataSetPlan:
    """The data set of `material`, `scene.*`, `simulation.*` and `data.*`.

    simulation.time_step=auto is the step that the fastest and stiffest scene of the data set allows.
    raises  UserError, also when a scene of it would not be stable
    """
    plan = _plan(config, settings_from(config, automatic=SimulationSettings.time_step))
    starts = [start for starts in planned_scenes(plan).values() for start in starts]
    stiffest = max(starts, key=_cfl)
    if config.simulation.time_step == "auto":
        return _plan(
            config, settings_from(config, automatic_time_step(stiffest.lightest, stiffest.parameters, _speed(stiffest)))
        )
    least_stable = max(
        starts, key=lambda start: _cfl(start) / stable_cfl(start.material, start.parameters["poissons_ratio"])
    )
    check_time_step(least_stable.lightest, least_stable.parameters, _speed(least_stable), least_stable.material)
    return plan


def ready_data_set(config: DictConfig) -> dict[str, list[Path]]:
    """Files of the configured data set by split ('train', 'validation', 'test'); what is missing is made.

    raises  UserError when data.folder holds another data set, SimulationDiverged naming the scene
    """
    check_ending("data.folder", config.data.folder)
    plan = plan_from(config)
    if plan.body.velocity.any() or plan.body.deformation is not None:
        log.warning(
            "scene.particles=%s: its velocities and deformations are not used: a data set draws its motions",
            config.scene.particles,
        )
    with _progress() as report:
        return generate_data_set(plan, str(config.data.folder), execution_from(config), report)


def _plan(config: DictConfig, settings: SimulationSettings) -> DataSetPlan:
    for option in ("velocity", "spin"):
        if any(component != 0.0 for component in config.scene[option]):
            raise UserError(
                f"scene.{option}={list(config.scene[option])} is not accepted here: the motions of a data "
                "set are drawn; accepted: [0, 0, 0]"
            )
    if config.scene.affine != "zero":
        raise UserError(
            f"scene.affine={config.scene.affine} is not accepted here: the scenes of a data set start with C = 0, as "
            "in the paper; accepted: zero"
        )
    return DataSetPlan(
        material=material_from(config),
        settings=settings,
        body=body_from(config),
        steps=whole_number(config, "simulation.steps"),
        every=whole_number(config, "data.every"),
        keyframe_every=whole_number(config, "data.keyframe_every"),
        train_scenes=whole_number(config, "data.train_scenes"),
        validation_scenes=whole_number(config, "data.validation_scenes"),
        seed=whole_number(config, "data.seed", least=0),
        precision=str(precision_from(config)).removeprefix("torch."),
    )


def _cfl(start: SceneStart) -> float:
    return scene_cfl(start.lightest, start.parameters, _speed(start))


def _speed(start: SceneStart) -> float:
    return largest_speed(start.position, start.velocity, start.settings)


@contextmanager
def _progress() -> Iterator[Report]:
    """A progress bar with the time left, on stderr, gone when done; where nobody watches, a line for each split."""
    console = Console(stderr=True)
    if not console.is_terminal:
        said = set()

        def say(description: str, done: int, total: int) -> None:
            if description not in said:
                said.add(description)
                console.print(f"making data: {description}, {done / total:.0%} done")

        yield say
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("data set", total=None)

        def report(description: str, done: int, total: int) -> None:
            bar.update(task, description=description, completed=done, total=total)

        yield report
