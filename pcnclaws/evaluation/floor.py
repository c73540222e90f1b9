"""The floor of an error: how far the analytic law itself is from the truth when only its numerics change."""

from collections.abc import Sequence
from dataclasses import replace

import torch

from pcnclaws.evaluation.divergence import survivors
from pcnclaws.evaluation.frames import in_time_step
from pcnclaws.evaluation.tasks import SceneResult, evaluate_records, mean_mse
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.materials import material_named
from pcnclaws.simulation.execution import SINGLE_ON_CPU, Execution
from pcnclaws.simulation.law_simulator import LawSimulator
from pcnclaws.simulation.records import SceneRecord

UNITS = {
    "float64": "mse of the analytic law in double precision against the same truth",
    "half_step": "mse of the analytic law in double precision with half the time step",
}


def floor(records: Sequence[SceneRecord], execution: Execution = SINGLE_ON_CPU) -> dict[str, float | None]:
    """Mean errors [m^2] of the analytic law in float64, and in float64 with half the time step.

    A scene that diverges even so is left out; None where all do.
    execution  double precision whatever it says; its progress hears of 2 x len(records) scenes in all
    """
    analytic = LawSimulator(analytic_laws(material_named(records[0].material)))
    silent = replace(execution, dtype=torch.float64, progress=None)

    def run(scenes: Sequence[SceneRecord]) -> list[SceneResult]:
        return evaluate_records(scenes, analytic, silent)

    # without the full states, nothing but the positions is compared
    whole = [replace(record, keyframes=None) for record in records]
    halved = [in_time_step(record, 0.5 * record.settings.time_step) for record in whole]
    outcomes = [survivors(scenes, run, execution.progress) for scenes in (whole, halved)]
    return {
        name: mean_mse([result for result in found if isinstance(result, SceneResult)])
        for name, found in zip(UNITS, outcomes, strict=True)
    }
