"""Generated data sets that a configuration asks for, made where they are missing."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from pcnclaws.commands.configuration import (
    body_from,
    execution_from,
    precision_from,
    settings_from,
    whole_number,
)
from pcnclaws.commands.outputs import check_ending
from pcnclaws.commands.typed_configs import GenerateConfig
from pcnclaws.data.generation import Progress as Report
from pcnclaws.data.generation import generate_data_set
from pcnclaws.data.sampling import DataSetPlan, planned_scenes
from pcnclaws.errors import UserError
from pcnclaws.laws.materials import material_named
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.simulation.time_step import stability_of

log = logging.getLogger(__name__)


def plan_from(config: GenerateConfig) -> DataSetPlan:
    """The data set of `material`, `scene.*`, `simulation.*` and `data.*`.

    simulation.time_step=auto is the step that the fastest and stiffest scene of the data set allows.
    raises  UserError, also when a scene of it would not be stable
    """
    settings = settings_from(config.simulation, material_named(config.material.name), SimulationSettings.time_step)
    plan = _plan(config, settings)
    scenes = [stability_of(start) for starts in planned_scenes(plan).values() for start in starts]
    if config.simulation.time_step == "auto":
        stiffest = max(scenes, key=lambda scene: scene.cfl)
        return _plan(config, replace(settings, time_step=stiffest.automatic_time_step))
    max(scenes, key=lambda scene: scene.cfl / scene.stable_cfl).check()
    return plan


def ready_data_set(config: GenerateConfig) -> dict[str, list[Path]]:
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


def _plan(config: GenerateConfig, settings: SimulationSettings) -> DataSetPlan:
    for option in ("velocity", "spin"):
        if any(component != 0.0 for component in getattr(config.scene, option)):
            raise UserError(
                f"scene.{option}={getattr(config.scene, option)} is not accepted here: the motions of a data "
                "set are drawn; accepted: [0, 0, 0]"
            )
    if config.scene.affine != "zero":
        raise UserError(
            f"scene.affine={config.scene.affine} is not accepted here: the scenes of a data set start with C = 0, as "
            "in the paper; accepted: zero"
        )
    return DataSetPlan(
        material=material_named(config.material.name),
        settings=settings,
        body=body_from(config.scene),
        steps=whole_number(config.simulation.steps, "simulation.steps"),
        every=whole_number(config.data.every, "data.every"),
        keyframe_every=whole_number(config.data.keyframe_every, "data.keyframe_every"),
        train_scenes=whole_number(config.data.train_scenes, "data.train_scenes"),
        validation_scenes=whole_number(config.data.validation_scenes, "data.validation_scenes"),
        seed=whole_number(config.data.seed, "data.seed", least=0),
        speed=float(config.data.speed),
        spin=float(config.data.spin),
        precision=str(precision_from(config.precision)).removeprefix("torch."),
    )


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
