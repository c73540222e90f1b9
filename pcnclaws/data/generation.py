"""Generation of data sets: one file a scene, finished scenes kept whatever happens to the process that makes them.

    <folder>/data_set.json                    the plan that the folder belongs to
    <folder>/train|validation|test/<name>.h5  one scene each

A file appears whole or not at all. The same command again makes only what is missing, and the result is the same:
scenes are simulated in fixed batches, so that their rounding does not depend on what was there before.
"""

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from pcnclaws.atomic import remove_partial_files, replaced_file
from pcnclaws.data.hdf5 import read_scenes, write_scenes
from pcnclaws.data.locks import one_after_another
from pcnclaws.data.sampling import MAXIMUM_SPEED, MAXIMUM_SPIN, SPLITS, DataSetPlan, planned_scenes
from pcnclaws.data.scene_settings import described_settings
from pcnclaws.errors import UserError
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.simulation.execution import SINGLE_ON_CPU, Execution
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.simulation.scenes import SceneStart

MANIFEST = "data_set.json"
# Raised whenever the same plan would give other data, so that older data is not taken for it.
GENERATION = 1
SCENES_OF_BATCH = 4

# Called with a description, the steps done so far and the steps in all.
Progress = Callable[[str, int, int], None]


def generate_data_set(
    plan: DataSetPlan,
    folder: str | Path,
    execution: Execution = SINGLE_ON_CPU,
    progress: Progress | None = None,
) -> dict[str, list[Path]]:
    """Makes what is missing of a data set, with the analytic laws; the files by split.

    execution  how the scenes are simulated; no part of the plan, since the data is the same within rounding; the
               precision is the plan's
    raises     UserError when the folder holds other data, SimulationDiverged naming the scene
    """
    folder = Path(folder)
    scenes = planned_scenes(plan)
    _make_folder(folder)
    # a second process that wants the same data waits, and finds it made
    with one_after_another(folder):
        _claim(folder, plan)
        missing = _missing_batches(plan, folder, scenes)
        for number, (split, batch) in enumerate(missing):
            report = _of_batch(progress, split, plan.steps, number, len(missing))
            _make_batch(plan, folder / split, batch, replace(execution, progress=report))
    return {split: [folder / split / f"{start.name}.h5" for start in scenes[split]] for split in SPLITS}


def read_split(folder: str | Path, split: str) -> list[SceneRecord]:
    """The scenes of one split of a data set, sorted by name."""
    return [record for path in sorted((Path(folder) / split).glob("*.h5")) for record in read_scenes(path)]


def _make_folder(folder: Path) -> None:
    try:
        for split in SPLITS:
            (folder / split).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"data.folder={folder} cannot be made ({error.strerror}); accepted: a folder") from error


def _missing_batches(
    plan: DataSetPlan, folder: Path, scenes: dict[str, list[SceneStart]]
) -> list[tuple[str, list[SceneStart]]]:
    """The batches of which a scene is missing. Which scenes share a batch depends on the plan alone."""
    missing = []
    for split in SPLITS:
        remove_partial_files(folder / split)
        for first in range(0, len(scenes[split]), SCENES_OF_BATCH):
            batch = scenes[split][first : first + SCENES_OF_BATCH]
            if not all(_is_made(plan, folder / split / f"{start.name}.h5", start) for start in batch):
                missing.append((split, batch))
    return missing


def _make_batch(
    plan: DataSetPlan,
    folder: Path,
    batch: Sequence[SceneStart],
    execution: Execution,
) -> None:
    frames = FramePlan(plan.steps, plan.every, plan.keyframe_every, velocities=True)
    execution = replace(execution, dtype=getattr(torch, plan.precision))
    records = simulate_records(batch, analytic_laws(plan.material), frames, execution)
    for start, record in zip(batch, records, strict=True):
        path = folder / f"{record.name}.h5"
        if not _is_made(plan, path, start):
            write_scenes(path, [record])


def _is_made(plan: DataSetPlan, path: Path, start: SceneStart) -> bool:
    """Whether the file holds the planned scene, complete and undamaged."""
    if not path.exists():
        return False
    try:
        record = read_scenes(path)[0]
        steps = record.frame_steps()
    except UserError:
        return False
    keyframe_steps = [] if record.keyframes is None else record.keyframes.step.tolist()
    return (
        (record.name, record.material, record.settings, dict(record.parameters))
        == (start.name, start.material, start.settings, dict(start.parameters))
        and steps.tolist() == list(range(0, plan.steps + 1, plan.every))
        and keyframe_steps == list(range(0, plan.steps + 1, plan.keyframe_every))
        and record.position.dtype == plan.precision
        and np.array_equal(record.position[0], start.position.astype(plan.precision))
        and record.initial_velocity is not None
        and np.array_equal(record.initial_velocity, start.velocity.astype(plan.precision))
    )


def _claim(folder: Path, plan: DataSetPlan) -> None:
    """Writes the manifest of a new data set; refuses a folder that belongs to another one."""
    remove_partial_files(folder)
    manifest, wanted = folder / MANIFEST, _description(plan)
    if not manifest.exists():
        if any(path.suffix == ".h5" for split in SPLITS for path in (folder / split).iterdir()):
            raise UserError(f"data.folder={folder} holds trajectories but no {MANIFEST}; accepted: a new folder")
        with replaced_file(manifest) as part:
            part.write(f"{json.dumps(wanted, indent=2)}\n".encode())
        return
    found = read_manifest(manifest)
    names = [name for name in sorted({*wanted, *found}) if wanted.get(name) != found.get(name)]
    if names:
        changes = ", ".join(f"{name} {_short(found.get(name))} instead of {_short(wanted.get(name))}" for name in names)
        raise UserError(
            f"data.folder={folder} holds a data set made with other options ({changes}); "
            "accepted: the same options, or another folder"
        )


def read_manifest(manifest: Path) -> dict[str, Any]:
    """What the manifest of a data set says; UserError for a file that is none."""
    try:
        found = json.loads(manifest.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise UserError(f"{manifest}: not readable ({error}); accepted: the manifest of a data set") from error
    if not isinstance(found, dict):
        raise UserError(f"{manifest}: not the manifest of a data set")
    return found


def _description(plan: DataSetPlan) -> dict[str, Any]:
    """The plan in plain types, equal for two plans if and only if they give the same data."""
    body = np.concatenate((plan.body.position, plan.body.volume[:, None]), axis=1).astype("<f8")
    settings = {f"simulation.{name}": value for name, value in described_settings(plan.settings).items()}
    # a manifest of particles of the same density is what it was before densities could differ
    own = (
        {}
        if plan.body.density is None
        else {"density": hashlib.sha256(plan.body.density.astype("<f8").tobytes()).hexdigest()}
    )
    return {
        "generation": GENERATION,
        "material": plan.material.name,
        "ranges": {name: list(limits) for name, limits in plan.material.ranges.items()},
        **_kinds(plan),
        **settings,
        "simulation.steps": plan.steps,
        "data.every": plan.every,
        "data.keyframe_every": plan.keyframe_every,
        "data.train_scenes": plan.train_scenes,
        "data.validation_scenes": plan.validation_scenes,
        "data.seed": plan.seed,
        **_other_motions(plan),
        "precision": plan.precision,
        "particles": len(body),
        **own,
        "body": hashlib.sha256(body.tobytes()).hexdigest(),
    }


def _kinds(plan: DataSetPlan) -> dict[str, Any]:
    """The kinds of body of a material that holds several."""
    kinds = [
        {name: list(limits) for name, limits in kind.ranges.items()} | dict(kind.fixed) for kind in plan.material.kinds
    ]
    return {"kinds": kinds} if kinds else {}


def _other_motions(plan: DataSetPlan) -> dict[str, float]:
    """What of the motions is not the default: a manifest says no more than it did before they could be chosen."""
    limits = {"data.speed": (plan.speed, MAXIMUM_SPEED), "data.spin": (plan.spin, MAXIMUM_SPIN)}
    return {name: value for name, (value, default) in limits.items() if value != default}


def _short(value: object) -> str:
    text = str(value)
    return text if len(text) <= 40 else f"{text[:12]}..."


def _of_batch(
    progress: Progress | None, split: str, steps: int, number: int, batches: int
) -> Callable[[int], None] | None:
    """The progress of one batch, reported as a part of all batches."""
    if progress is None:
        return None
    done = number * steps

    def report(advance: int) -> None:
        nonlocal done
        done += advance
        progress(f"{split} scenes", done, batches * steps)

    return report
