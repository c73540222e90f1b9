"""Scenes of a training run: which ones it trains on and which it is validated with."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch

from pcnclaws.data.first_motion import name_contradictions
from pcnclaws.data.hdf5 import read_scenes
from pcnclaws.data.start_velocity import with_start_velocity
from pcnclaws.data.trajectory_files import read_trajectories
from pcnclaws.data.units import check_record
from pcnclaws.errors import UserError
from pcnclaws.laws.base import Elasticity
from pcnclaws.laws.materials import MATERIALS, Material
from pcnclaws.laws.parameters import validate_parameters
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.simulation.scenes import start_of
from pcnclaws.training.module import ConstitutiveModule

# Share of a user's own scenes that is kept for the checks, and the fewest scenes that can spare one.
VALIDATION_SHARE, FEWEST_TO_SPLIT = 0.15, 3

# Deformations that a law is shown before its training, of all scenes together.
DEFORMATIONS = 200_000


@dataclass(frozen=True)
class TrainingScenes:
    """The scenes of a run.

    test    scenes for the numbers at the end, never trained on
    ranges  span of each physical parameter that the law will be trained on
    notes   what the user should know about the choice, one line each
    """

    training: list[SceneRecord]
    validation: list[SceneRecord]
    test: list[SceneRecord]
    ranges: Mapping[str, tuple[float, float]]
    notes: tuple[str, ...] = ()


def own_scenes(paths: Sequence[Path], material: Material) -> TrainingScenes:
    """The scenes of the user's own trajectory files; the last of them for the checks when there are enough.

    raises  UserError if a scene is of another material, or lacks a parameter
    """
    records = [record for path in paths for record in _checked(path, material)]
    spare = max(1, round(VALIDATION_SHARE * len(records))) if len(records) >= FEWEST_TO_SPLIT else 0
    training, validation = records[: len(records) - spare], records[len(records) - spare :]
    note = (
        f"{len(training)} scenes to train on, {len(validation)} for the checks: "
        f"{', '.join(record.name for record in validation)}"
        if validation
        else f"the checks use the training scenes: fewer than {FEWEST_TO_SPLIT} scenes"
    )
    checks = validation or training
    return TrainingScenes(training, checks, checks, _spans(training, material.parameter_names), (note,))


def generated_scenes(files: Mapping[str, Sequence[Path]], material: Material) -> TrainingScenes:
    """The scenes of a generated data set, by split; the material's reference objects for the test, if any."""
    splits = {split: [record for path in paths for record in read_scenes(path)] for split, paths in files.items()}
    test, unseen = splits["test"], f"{len(splits['test'])} unseen objects for the test"
    if not test:
        test, unseen = splits["validation"], f"which are the test, too: {material.name} has no reference objects"
    notes = (f"{len(splits['train'])} scenes to train on, {len(splits['validation'])} for the checks, {unseen}",)
    return TrainingScenes(splits["train"], splits["validation"], test, material.ranges, notes)


def for_regime(scenes: TrainingScenes, module: type[ConstitutiveModule], scene: str | int | None) -> TrainingScenes:
    """The scenes that a regime trains on. A law of one scene is checked with that scene."""
    chosen = module.choose_scenes(scenes.training, scene)
    if len(chosen) == len(scenes.training):
        return scenes
    note = f"trains on scene '{chosen[0].name}' alone; the checks and the first line of the test use it too"
    return TrainingScenes(chosen, chosen, chosen + scenes.test, _spans(chosen, scenes.ranges), (*scenes.notes, note))


def can_restart(record: SceneRecord) -> bool:
    """Whether a scene holds full states between its first frame and its last."""
    if record.keyframes is None:
        return False
    step = record.keyframes.step
    return bool(((step > 0) & (step < record.frame_steps()[-1])).any())


def show_deformations(law: Elasticity, records: Sequence[SceneRecord], beside: bool = False) -> None:
    """Shows the law the deformations of the recorded full states, if there are any; some thousand particles of each.

    beside  what the law has seen before counts, too
    """
    states = [record.keyframes.deformation for record in records if record.keyframes is not None]
    if not states:
        return
    each = max(1, DEFORMATIONS // len(states))
    flat = [one.reshape(-1, 3, 3) for one in states]
    some = np.concatenate([one[:: max(1, len(one) // each)] for one in flat])
    law.see(torch.from_numpy(some.astype(np.float64)).permute(1, 2, 0).contiguous(), beside)


def _spans(records: Sequence[SceneRecord], names: Iterable[str]) -> dict[str, tuple[float, float]]:
    """Smallest and largest value of each physical parameter."""
    values = {name: [record.parameters[name] for record in records] for name in names}
    return {name: (min(of_name), max(of_name)) for name, of_name in values.items()}


def _checked(path: Path, material: Material) -> list[SceneRecord]:
    records = [with_start_velocity(record) for record in read_trajectories(path, material.name)]
    for record in records:
        # a name of the user's own is a body whose law is in no table: only its parameters must be the material's
        if record.material in MATERIALS and record.material != material.name:
            raise UserError(
                f"{record.label} is of material '{record.material}'; "
                f"accepted: {material.name}, or material={record.material} on the command line"
            )
        validate_parameters(
            {name: record.parameters[name] for name in material.parameter_names if name in record.parameters},
            material.parameter_names,
            f"{record.label}: parameters",
        )
        start_of(record)  # refuses what cannot be simulated
        if not np.isfinite(record.position[1:]).any():
            raise UserError(f"{record.label}: no particle is observed after the first frame; accepted: observed motion")
        check_record(record)
    name_contradictions(records)
    return [
        replace(
            record,
            material=material.name,
            parameters={name: record.parameters[name] for name in material.parameter_names},
        )
        for record in records
    ]
