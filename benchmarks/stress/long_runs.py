"""Twenty thousand steps: does a scene stay finite, keep its energy after the last impact, stay where it lies?"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch

import pcnclaws as pc
from benchmarks.stress.cases import DX, base_scene, law_of
from pcnclaws.evaluation.energy import potential_energy, scene_energy
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.simulation.batch import batch_scenes
from pcnclaws.simulation.scenes import restarted

# An impact: the body as a whole turns from falling to rising within a frame.
EVERY = 100
# What is asked of each: growth of the energy over that of the start, drift over dx, change of F within yield.
MOST_GROWTH, MOST_DRIFT, MOST_CREEP = 1e-3, 1e-3, 1e-6


def long_run(material: str, law: str, steps: int) -> dict[str, Any]:
    """{"growth", "drift", "floating_drift", "creep"}: see the functions below; None where there is no such thing."""
    model = law_of(material, law)
    dropped = base_scene(model, velocity=(0.0, -1.0, 0.0))
    motion = dropped.simulate(steps, EVERY, deformation=True)
    floating = base_scene(
        model,
        velocity=(0.0, 0.0, 0.0),
        settings=pc.Settings(time_step=dropped.time_step, gravity=(0.0, 0.0, 0.0)),
    ).simulate(steps, steps)
    return {
        "seconds": dropped.time_step * steps,
        "growth": _growth(dropped, motion),
        "drift": _drift(motion),
        "floating_drift": float((floating.position[-1] - floating.position[0]).norm(dim=1).max()) / DX,
        "creep": _creep(model) if model.material.plastic else None,
    }


def verdicts(row: Mapping[str, Any]) -> dict[str, bool]:
    """Which of the figures are within what is asked."""
    bounds = {"growth": MOST_GROWTH, "drift": MOST_DRIFT, "floating_drift": MOST_DRIFT, "creep": MOST_CREEP}
    return {name: row[name] <= bound for name, bound in bounds.items() if row[name] is not None}


def _growth(scene: pc.Scene, motion: pc.Motion) -> float:
    """Largest growth of the energy from one frame to any later one after the last impact, over that of the start.

    Kinetic, elastic (by the analytic law) and gravitational energy.
    """
    energy = _energies(scene, motion)
    vertical = motion.velocity[:, :, 1].double().mean(1)
    falls = (vertical[:-1] < -0.05) & (vertical[1:] > 0.05)
    last = int(falls.nonzero().max()) + 1 if bool(falls.any()) else int((vertical < -0.05).nonzero().max()) + 1
    after = energy[min(last, len(energy) - 2) :]
    lowest = np.minimum.accumulate(after)
    return float((after - lowest).max() / energy[0])


@torch.no_grad()
def _energies(scene: pc.Scene, motion: pc.Motion) -> np.ndarray:
    start, record = scene._start, motion.record
    elasticity = analytic_laws(scene.law.material).elasticity
    keyframes = record.keyframes
    if keyframes is None:
        raise ValueError("a motion without restart states has no energy")
    found = []
    for row in range(len(keyframes.step)):
        batch = batch_scenes([restarted(start, keyframes, row)], torch.float64)
        fields, settings = (batch.state, batch.scenes), start.settings
        lively = scene_energy(*fields, batch.parameters, elasticity, settings.grid_spacing)
        found.append(float(lively + potential_energy(*fields, settings.floor)))
    return np.array(found)


def _drift(motion: pc.Motion) -> float:
    """How far the middle of the body moves in the last quarter, over dx."""
    middle = motion.position.double().mean(1)
    late = middle[3 * len(middle) // 4 :]
    return float((late - late[0]).norm(dim=1).max()) / DX


def _creep(law: pc.ConstitutiveModel) -> float:
    """Largest change of F by the return map where the analytic law does not flow, over many strains of 1e-6 to 1e-2."""
    generator = torch.Generator().manual_seed(0)
    count = 20_000
    size = 10.0 ** (-6.0 + 4.0 * torch.rand(count, 1, 1, generator=generator, dtype=torch.float64))
    gradient = size * (torch.rand(count, 3, 3, generator=generator, dtype=torch.float64) - 0.5)
    # compressed, where sand has strength
    trial = torch.linalg.matrix_exp(gradient - size * torch.eye(3, dtype=torch.float64))
    values: dict[str, Any] = {name: 0.5 * (low + high) for name, (low, high) in law.ranges.items()}
    truth = pc.analytic_law(law.material)
    still = ((truth.return_map(trial, **values) - trial).abs().amax((1, 2)) == 0.0) & _well_inside(truth, trial, values)
    change = (law.return_map(trial, **values) - trial).abs().amax((1, 2))
    return float(change[still].max())


def _well_inside(truth: pc.ConstitutiveModel, trial: torch.Tensor, values: Mapping[str, Any]) -> torch.Tensor:
    """Whether a strain a tenth larger still does not flow: the surface itself is where laws may differ."""
    u, s, v = torch.linalg.svd(trial)
    log = s.log()
    middle = log.mean(1, keepdim=True)
    larger = u @ torch.diag_embed((middle + 1.1 * (log - middle)).exp()) @ v
    return (truth.return_map(larger, **values) - larger).abs().amax((1, 2)) < 1e-12
