"""Evaluates laws: simulates recorded scenes from their first frames and measures how far the motion is off."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float

from pcnclaws.data.records import TIME_TOLERANCE, SceneRecord
from pcnclaws.data.scenes import SceneStart, group_by_settings, simulate_records, start_of
from pcnclaws.errors import UserError
from pcnclaws.evaluation.stress import stress_error
from pcnclaws.laws.materials import Laws, Material, analytic_laws, material_named
from pcnclaws.metrics import mse_sum, position_mse, position_mse_by_frame, rms_percent
from pcnclaws.skips import Skips
from pcnclaws.time_step import automatic_time_step, largest_speed


@dataclass(frozen=True)
class SceneResult:
    """The error of one predicted scene.

    mse           mean over particles, coordinates and the file's frames [m^2]
    mse_sum       the same with the coordinates summed [m^2]
    rms_percent   root of mse_sum in percent of the object's size
    mse_by_frame  [m^2], (frames,)
    stress_error  relative stress error [-] at the recorded states after contact, None without such states
    predicted     what the law gives, at the times of the true record
    """

    true: SceneRecord
    predicted: SceneRecord
    mse: float
    mse_sum: float
    rms_percent: float
    mse_by_frame: Float[np.ndarray, " frames"]
    stress_error: float | None

    @property
    def name(self) -> str:
        """Name of the scene."""
        return self.true.name

    @property
    def parameters(self) -> Mapping[str, float]:
        """Physical parameters of the scene."""
        return self.true.parameters

    @property
    def time(self) -> Float[np.ndarray, " frames"]:
        """Time since the first frame [s], (frames,)."""
        return self.true.time - self.true.time[0]


def evaluate_records(
    records: Sequence[SceneRecord],
    laws: Laws,
    dtype: torch.dtype = torch.float32,
    device: str | torch.device = "cpu",
    progress: Callable[[int], None] | None = None,
    skips: Skips | None = None,
) -> list[SceneResult]:
    """Simulates each record from its first frame with its own parameters and settings and compares at its frames.

    A frame that lies between two steps is compared with the linear interpolation of the two.
    progress  called with the number of steps just done, of `steps_to_run(records)` in all
    skips     what the simulation leaves out, everything that it can by default
    raises    UserError for a record that cannot be evaluated; SimulationDiverged
    """
    material = _material_of(records)
    starts = [_start(record, material) for record in records]
    predicted: dict[int, SceneRecord] = {}
    for (steps, every), members in _plans(records).items():
        group = [starts[index] for index in members]
        runs = simulate_records(group, laws, steps, every, 0, dtype, device, progress, skips)
        for index, run in zip(members, runs, strict=True):
            predicted[index] = _at_frames_of(records[index], run.position, every)
    analytic = analytic_laws(material)
    return [_compared(record, predicted[index], laws, analytic) for index, record in enumerate(records)]


def steps_to_run(records: Sequence[SceneRecord]) -> int:
    """Number of steps that evaluate_records reports to its `progress` in all."""
    groups = {plan: [records[index] for index in members] for plan, members in _plans(records).items()}
    return sum(steps * len(group_by_settings(group)) for (steps, _), group in groups.items())


def in_automatic_time_step(record: SceneRecord) -> SceneRecord:
    """The record with the settings of a time step of its own: the longest of CFL number 0.4 that meets its frames.

    Where the frames lie between the steps of the record anyway, the longest of all.
    """
    start, places = start_of(record), _places(record)
    speed = largest_speed(start.position, start.velocity, start.settings.gravity, start.settings.wall_distance)
    step = automatic_time_step(start.settings, start.parameters, speed)
    if places[-1] > 0.0 and (places == np.rint(places)).all():
        spacing = math.gcd(*places.astype(np.int64).tolist()) * record.settings.time_step
        step = spacing / math.ceil(spacing / step)
    return replace(record, settings=replace(record.settings, time_step=step))


def mean_mse(results: Sequence[SceneResult]) -> float:
    """Mean of the scenes' MSE [m^2]."""
    return float(np.mean([result.mse for result in results]))


def require_material(records: Sequence[SceneRecord], material: Material) -> None:
    """Refuses records of another material with a UserError that names the first one."""
    for record in records:
        if record.material != material.name:
            raise UserError(
                f"material={material.name} does not fit {record.label}, which is of "
                f"material '{record.material}'; accepted: a file of {material.name}"
            )


def _material_of(records: Sequence[SceneRecord]) -> Material:
    material = material_named(records[0].material, f"{records[0].label}: material")
    require_material(records, material)
    return material


def _start(record: SceneRecord, material: Material) -> SceneStart:
    """The start of a record with the parameters of its material, and no others that the file may hold."""
    if not np.isfinite(record.position[1:]).any():
        raise UserError(f"{record.label}: has no observed particle after its first frame; nothing to compare with")
    start = start_of(record)
    return replace(start, parameters={name: start.parameters[name] for name in material.parameter_names})


def _places(record: SceneRecord) -> Float[np.ndarray, " frames"]:
    """Where the frames lie, in steps after the first one; whole numbers if all are, but for rounded times."""
    places = (record.time - record.time[0]) / record.settings.time_step
    whole = np.rint(places)
    return whole if np.abs(places - whole).max() <= TIME_TOLERANCE else places


def _plans(records: Sequence[SceneRecord]) -> dict[tuple[int, int], list[int]]:
    """(steps to simulate, steps between kept frames) -> indices of the records for which it is right."""
    plans: dict[tuple[int, int], list[int]] = {}
    for index, record in enumerate(records):
        places = _places(record)
        whole = bool((places == np.rint(places)).all())
        every = math.gcd(*places.astype(np.int64).tolist()) if whole else 1
        plans.setdefault((math.ceil(places[-1]), max(every, 1)), []).append(index)
    return plans


def _at_frames_of(record: SceneRecord, position: Float[np.ndarray, "kept particles 3"], every: int) -> SceneRecord:
    """The simulated positions, kept every `every` steps, as a record with the frames of the given one."""
    place = _places(record) / every
    below = np.floor(place).astype(np.int64)
    above = np.minimum(below + 1, len(position) - 1)
    share = (place - below).astype(np.float32)[:, None, None]
    at_frames = np.where(share > 0.0, (1.0 - share) * position[below] + share * position[above], position[below])
    return replace(record, position=at_frames.astype(np.float32), velocity=None, keyframes=None)


def _compared(true: SceneRecord, predicted: SceneRecord, laws: Laws, analytic: Laws) -> SceneResult:
    mse = position_mse(predicted.position, true.position)
    summed = mse_sum(mse)
    return SceneResult(
        true,
        predicted,
        mse,
        summed,
        rms_percent(summed, true.volume),
        position_mse_by_frame(predicted.position, true.position),
        stress_error(true, laws, analytic),
    )
