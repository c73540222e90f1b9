"""What becomes of a stressed scene: it holds, it is refused or stopped with a reason, or it is at fault."""

import math
import re
from typing import Any

import numpy as np
import torch

import pcnclaws as pc
from benchmarks.stress.cases import StressCase, law_of
from pcnclaws.errors import SimulationDiverged, UserError
from pcnclaws.evaluation.energy import scene_energy
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.simulation.batch import batch_scenes
from pcnclaws.simulation.execution import Execution
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.simulation.scenes import SceneStart
from pcnclaws.simulation.time_step import stability_of

HOLDS, REFUSED, STOPPED, GAINS, FAULT = "holds", "refused", "stopped", "gains energy", "fault"
EVERY = 5
# Kinetic energy and that of gravity above the floor may exceed those of the start by this share.
TOLERANCE = 0.1
# What a message that stops a run must name, beside what to change.
NAMED = (r"scene '", r"step \d+", r"particle \d+", "; ")


def fate_of(case: StressCase) -> dict[str, Any]:
    """{"fate", "reason": what was said, "energy": the largest over that of the start, or None}."""
    law = law_of(case.material, case.law)
    try:
        start = case.start(law)
        record = _motion(start, law, case)
    except UserError as error:
        return _row(REFUSED if _one_line(error) else FAULT, str(error))
    except SimulationDiverged as error:
        complete = all(re.search(pattern, str(error)) for pattern in NAMED)
        return _row(STOPPED if complete and _one_line(error) else FAULT, str(error))
    except Exception as error:  # a fault is what this looks for
        return _row(FAULT, f"{type(error).__name__}: {error}")
    if record.velocity is None or not (np.isfinite(record.position).all() and np.isfinite(record.velocity).all()):
        return _row(FAULT, "positions or velocities that are not finite came back")
    energy = _most_energy(start, law, record)
    if energy is not None and energy > 1.0 + TOLERANCE:
        return _row(GAINS, f"{energy:.3g} times the energy of the start", energy)
    return _row(HOLDS, "", energy)


def _motion(start: SceneStart, law: pc.ConstitutiveModel, case: StressCase) -> SceneRecord:
    plan = FramePlan(case.steps, EVERY, 0, velocities=True)
    try:
        with torch.no_grad():
            return simulate_records([start], law.laws, plan, Execution(case.dtype, torch.device("cpu")))[0]
    except SimulationDiverged as error:
        raise type(error)(f"{error}; {stability_of(start, law.material).advice(error)}") from error


def _row(fate: str, reason: str, energy: float | None = None) -> dict[str, Any]:
    return {"fate": fate, "reason": reason, "energy": energy}


def _one_line(error: Exception) -> bool:
    return "\n" not in str(error)


def _masses(start: SceneStart) -> np.ndarray:
    density = start.settings.density if start.density is None else start.density
    return start.volume * density


def _most_energy(start: SceneStart, law: pc.ConstitutiveModel, record: SceneRecord) -> float | None:
    """Largest kinetic energy and energy of gravity above the floor, over all that the scene can draw on.

    That is what it has at the start, with the elastic energy (of the analytic law) of a deformed body, and what moving
    obstacles give: a body that bounces off one gains twice its speed at most. None where there is nothing.
    """
    if record.velocity is None:
        return None
    mass, settings = _masses(start)[:, None], start.settings
    height = record.position - np.array([0.0, settings.floor, 0.0])
    kinetic = 0.5 * (mass * np.square(record.velocity, dtype=np.float64)).sum((1, 2))
    energy = kinetic - (mass * np.array(settings.gravity) * height).sum((1, 2))
    reach = float(np.ptp(start.position, axis=0).max())
    pushed = 2.0 * max((collider.speed(reach) for collider in settings.colliders), default=0.0)
    own = math.sqrt(2.0 * (energy[0] + _hidden_energy(start, law)) / mass.sum())
    drawn = 0.5 * float(mass.sum()) * (own + pushed) ** 2
    return float(energy.max() / drawn) if drawn > 0.0 else None


def _hidden_energy(start: SceneStart, law: pc.ConstitutiveModel) -> float:
    """Elastic energy of a deformed start, by the analytic law, and that of the spin within particles [J]."""
    batch = batch_scenes([start], torch.float64)
    elasticity = analytic_laws(law.material).elasticity.double()
    known = scene_energy(batch.state, batch.scenes, batch.parameters, elasticity, start.settings.grid_spacing)
    visible = 0.5 * float((_masses(start)[:, None] * np.square(start.velocity)).sum())
    return float(known) - visible
