"""Errors of a law: recorded scenes are simulated from their first frames and compared."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from pcnclaws.errors import UserError
from pcnclaws.evaluation.energy import energy_error
from pcnclaws.evaluation.frames import at_frames_of, step_plans
from pcnclaws.evaluation.stress import stress_error
from pcnclaws.laws.analytic import Laws, analytic_laws
from pcnclaws.laws.materials import Material, material_named
from pcnclaws.metrics import mse_sum, position_mse, position_mse_by_frame, rms_percent
from pcnclaws.simulation.execution import SINGLE_ON_CPU, Execution
from pcnclaws.simulation.motion import SceneSimulator
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.simulation.scenes import SceneStart, group_by_settings, start_of


@dataclass(frozen=True)
class SceneResult:
    """The error of one predicted scene.

    mse           mean over particles, coordinates and the file's frames [m^2]
    mse_sum       the same with the coordinates summed [m^2]
    rms_percent   root of mse_sum in percent of the object's size
    mse_by_frame  [m^2], (frames,)
    stress_error  relative stress error [-] at the recorded states after contact, None without such states
    energy_error  largest error of the total energy [-] at the keyframes, None without keyframes
    seconds       wall-clock time of the simulation, for scenes that ran as one batch their share of it [s]
    predicted     what the law gives, at the times of the true record
    """

    true: SceneRecord
    predicted: SceneRecord
    mse: float
    mse_sum: float
    rms_percent: float
    mse_by_frame: Float[np.ndarray, " frames"]
    stress_error: float | None
    energy_error: float | None = None
    seconds: float | None = None

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
    model: SceneSimulator,
    execution: Execution = SINGLE_ON_CPU,
) -> list[SceneResult]:
    """Simulates each record from its first frame with its own parameters and settings and compares at its frames.

    A frame that lies between two steps is compared with the linear interpolation of the two. A model without
    laws has neither stress nor full states, and no errors of these.
    execution  its progress hears of `steps_to_run(records)` steps in all
    raises     UserError for a record that cannot be evaluated; SimulationDiverged
    """
    material = _material_of(records)
    starts = [_start(record, material) for record in records]
    predicted: dict[int, SceneRecord] = {}
    seconds: dict[int, float] = {}
    for plan, members in step_plans(records).items():
        group, began = [starts[index] for index in members], time.perf_counter()
        runs = model.simulate(group, plan, execution)
        share = (time.perf_counter() - began) / len(members)
        for index, run in zip(members, runs, strict=True):
            predicted[index], seconds[index] = at_frames_of(records[index], run, plan.every), share
    laws, analytic = model.laws, analytic_laws(material)
    results = [_compared(record, predicted[k], analytic) for k, record in enumerate(records)]
    return [
        replace(
            result,
            stress_error=None if laws is None else stress_error(record, laws, analytic, execution.dtype),
            seconds=seconds[k],
        )
        for k, (result, record) in enumerate(zip(results, records, strict=True))
    ]


def steps_to_run(records: Sequence[SceneRecord]) -> int:
    """Number of steps that evaluate_records reports to its `progress` in all."""
    groups = {plan: [records[index] for index in members] for plan, members in step_plans(records).items()}
    return sum(plan.steps * len(group_by_settings(group)) for plan, group in groups.items())


def mean_mse(results: Sequence[SceneResult]) -> float | None:
    """Mean of the scenes' MSE [m^2], None without scenes."""
    return float(np.mean([result.mse for result in results])) if results else None


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


def _compared(true: SceneRecord, predicted: SceneRecord, analytic: Laws) -> SceneResult:
    """The errors of the motion."""
    mse = position_mse(predicted.position, true.position)
    summed = mse_sum(mse)
    return SceneResult(
        true=true,
        predicted=predicted,
        mse=mse,
        mse_sum=summed,
        rms_percent=rms_percent(summed, true.volume),
        mse_by_frame=position_mse_by_frame(predicted.position, true.position),
        stress_error=None,
        energy_error=energy_error(true, predicted, analytic.elasticity),
    )
