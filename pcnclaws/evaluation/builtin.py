"""The built-in tasks: scenes that everybody has without a file, and how their true motion is recorded."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pcnclaws.data.sampling import DataSetPlan, Motion, draw_motions, planned_scenes
from pcnclaws.errors import UserError, unknown_name
from pcnclaws.evaluation.divergence import DivergedScene, survivors
from pcnclaws.evaluation.parameter_map import map_settings, map_starts
from pcnclaws.geometry.shapes import PointCloud, particles, spin_velocity
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.materials import Material
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.simulation.execution import SINGLE_ON_CPU, Execution
from pcnclaws.simulation.placement import require_inside
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.simulation.scenes import SceneStart, group_by_settings

# Shape -> edge of its box [m] and particles along it: 3 to 8 particles a cell, 1000 to 3000 in all.
GEOMETRIES = {
    "sphere": (0.5, 16),
    "torus": (0.6, 20),
    "star": (0.6, 20),
    "twisted_bar": (0.6, 20),
    "hollow_box": (0.5, 15),
    "spiky_sphere": (0.6, 24),
}
# Seeds of motions that reach a wall in the first half of the time.
GEOMETRY_SEED, MOTION_SEED = (0, 7), (0, 3)
MOTION_SCENES = 6
# 4 m/s and 6 rad/s: faster than any motion of the training data.
FAST_MOTIONS = (
    Motion(np.array((8.0, -4.0, 8.0)) / 3.0, np.array((4.0, 4.0, 2.0))),
    Motion(np.array((-4.0, -8.0, 8.0)) / 3.0, np.array((2.0, -4.0, 4.0))),
)


@dataclass(frozen=True)
class BuiltinTask:
    """The scenes of a task and how they are recorded.

    plan         length of the motion and distances of its frames and full states [steps]
    may_diverge  a scene that diverges is a result and does not end the evaluation
    """

    starts: Sequence[SceneStart]
    plan: FramePlan
    may_diverge: bool = False

    @property
    def work(self) -> int:
        """What true_records reports to its `progress` in all."""
        return len(self.starts) if self.may_diverge else self.plan.steps * len(group_by_settings(self.starts))


def builtin_task(name: str, material: Material, scene: str | None = None) -> BuiltinTask:
    """The built-in task of that name.

    scene   name of a training scene: the task as it is for a law that was trained on that scene alone
    raises  UserError for an unknown name, and for a task that has no training scenes
    """
    if name not in TASKS:
        raise unknown_name("task", name, ["file", *TASKS])
    task = TASKS[name](material)
    return task if scene is None else _in_scene(name, task, material, scene)


def true_records(
    task: BuiltinTask, material: Material, execution: Execution = SINGLE_ON_CPU
) -> list[SceneRecord | DivergedScene]:
    """The scenes' true motion, by the analytic laws, as the standard data set records it in single precision.

    execution  its progress hears of the work just done, steps or scenes, of `task.work` in all
    raises     SimulationDiverged where the task does not take that for a result
    """
    laws, silent = analytic_laws(material), replace(execution, progress=None)
    if task.may_diverge:
        return survivors(
            task.starts, lambda starts: simulate_records(starts, laws, task.plan, silent), execution.progress
        )
    return [*simulate_records(task.starts, laws, task.plan, execution)]


def paper_errors(material: Material) -> dict[str, float]:
    """The paper's error [m^2] on those reference objects for which it gives one, by scene name."""
    return {thing.name: thing.paper_mse for thing in material.objects if thing.paper_mse is not None}


def _reconstruction(material: Material) -> BuiltinTask:
    return _of_plan(DataSetPlan(material), "train")


def _unseen(material: Material) -> BuiltinTask:
    return _of_plan(DataSetPlan(material), "test")


def _long_term(material: Material) -> BuiltinTask:
    return _of_plan(DataSetPlan(material, steps=1000), "train")


def _resolution(material: Material) -> BuiltinTask:
    """Finer grid, shorter steps and more particles; frames at the same times as in the standard data set."""
    finer = SimulationSettings(time_step=2.5e-4, grid_spacing=1 / 32)
    body = particles(particles_per_edge=16)
    return _of_plan(DataSetPlan(material, finer, body, steps=1000, every=10, keyframe_every=40), "test")


def _geometry(material: Material) -> BuiltinTask:
    """Shapes that are not cubes, with parameters of training scenes."""
    plan = DataSetPlan(material)
    scenes = zip(GEOMETRIES.items(), _training(plan), draw_motions(len(GEOMETRIES), GEOMETRY_SEED), strict=False)
    starts = [
        _start(shape, known, particles(shape, side=side, particles_per_edge=edge), motion)
        for (shape, (side, edge)), known, motion in scenes
    ]
    return BuiltinTask(starts, _frames(plan))


def _unseen_motion(material: Material) -> BuiltinTask:
    """Parameters of training scenes, thrown as none of these was; the last two faster than any."""
    plan = DataSetPlan(material)
    motions = [*draw_motions(MOTION_SCENES - len(FAST_MOTIONS), MOTION_SEED), *FAST_MOTIONS]
    starts = [
        _start(f"motion-{number:02d}", known, plan.body, motion)
        for number, (known, motion) in enumerate(zip(_training(plan), motions, strict=False))
    ]
    return BuiltinTask(starts, _frames(plan))


def _outside_range(material: Material) -> BuiltinTask:
    """The map of parameters, with frames at the same times as in the standard data set."""
    plan = DataSetPlan(material)
    settings = map_settings(material, plan)
    finer = round(plan.settings.time_step / settings.time_step)
    frames = FramePlan(finer * plan.steps, finer * plan.every, finer * plan.keyframe_every)
    return BuiltinTask(map_starts(material, plan, settings), frames, may_diverge=True)


def _of_plan(plan: DataSetPlan, split: str) -> BuiltinTask:
    return BuiltinTask(planned_scenes(plan)[split], _frames(plan))


def _frames(plan: DataSetPlan) -> FramePlan:
    return FramePlan(plan.steps, plan.every, plan.keyframe_every)


def _training(plan: DataSetPlan) -> list[SceneStart]:
    return planned_scenes(plan)["train"]


def _in_scene(name: str, task: BuiltinTask, material: Material, scene: str) -> BuiltinTask:
    """The training scene alone where the task is made of such, else all bodies of the task with its parameters."""
    if name not in SCENE_TASKS:
        raise UserError(f"task.scene={scene} does not go with task={name}; accepted with: {', '.join(SCENE_TASKS)}")
    known = {start.name: start for start in _training(DataSetPlan(material))}
    if scene not in known:
        raise unknown_name("task.scene", scene, known)
    if name in OF_TRAINING_SCENES:
        return replace(task, starts=[start for start in task.starts if start.name == scene])
    parameters = known[scene].parameters
    return replace(task, starts=[replace(start, parameters=parameters) for start in task.starts])


def _start(name: str, known: SceneStart, body: PointCloud, motion: Motion) -> SceneStart:
    """A scene with the parameters of a known one, another body or another motion."""
    require_inside(body.position, known.settings, f"scene '{name}'")
    velocity = spin_velocity(body.position, body.velocity + motion.velocity, motion.spin.tolist())
    return replace(known, name=name, position=body.position, velocity=velocity, volume=body.volume, density=None)


TASKS: dict[str, Callable[[Material], BuiltinTask]] = {
    "reconstruction": _reconstruction,
    "unseen": _unseen,
    "long_term": _long_term,
    "geometry": _geometry,
    "unseen_motion": _unseen_motion,
    "resolution": _resolution,
    "outside_range": _outside_range,
}
# Tasks that `scene` reduces to one training scene, and those in which it gives all bodies its parameters.
OF_TRAINING_SCENES = ("reconstruction", "long_term")
SCENE_TASKS = (*OF_TRAINING_SCENES, "geometry", "unseen_motion")
