"""The built-in tasks: scenes that everybody has without a file, in the paper's setting."""

from collections.abc import Callable

import torch

from pcnclaws.data.records import SceneRecord
from pcnclaws.data.reference_objects import reference_objects
from pcnclaws.data.sampling import DataSetPlan, planned_scenes
from pcnclaws.data.scenes import SceneStart, simulate_records
from pcnclaws.errors import unknown_name
from pcnclaws.laws.materials import Material, analytic_laws
from pcnclaws.skips import Skips

# Task -> split of the material's standard data set.
SPLITS = {"reconstruction": "train", "unseen": "test"}


def builtin_starts(task: str, material: Material) -> list[SceneStart]:
    """The scenes of a built-in task; UserError for an unknown one."""
    if task not in SPLITS:
        raise unknown_name("task", task, ["file", *SPLITS])
    return planned_scenes(DataSetPlan(material))[SPLITS[task]]


def true_records(
    starts: list[SceneStart],
    material: Material,
    device: str | torch.device = "cpu",
    progress: Callable[[int], None] | None = None,
    skips: Skips | None = None,
) -> list[SceneRecord]:
    """The scenes' true motion, by the analytic laws in single precision, as the standard data set records it.

    progress  called with the number of steps just done, of `steps_of_truth(material)` in all
    """
    plan = DataSetPlan(material)
    recorded = (plan.steps, plan.every, plan.keyframe_every)
    return simulate_records(starts, analytic_laws(material), *recorded, device=device, progress=progress, skips=skips)


def steps_of_truth(material: Material) -> int:
    """Number of steps that true_records reports to its `progress` in all."""
    return DataSetPlan(material).steps


def paper_errors(material: Material) -> dict[str, float]:
    """The paper's error [m^2] on those reference objects for which it gives one, by scene name."""
    return {thing.name: thing.paper_mse for thing in reference_objects(material.name) if thing.paper_mse is not None}
