"""For each switch of `simulation.skip.*` a scene where it applies, run with any set of switches."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import torch

from benchmarks.cases import PAPER, Case, laws_of
from pcnclaws.geometry.shapes import particles
from pcnclaws.laws.materials import material_named
from pcnclaws.mpm.contact import VERSION_1_STICK
from pcnclaws.simulation.execution import Execution
from pcnclaws.simulation.fast_paths import Skips
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.scenes import SceneStart

# A body that meets the floor is strained after two.
FEWEST_STEPS = 3
# All switches together.
ALL = "all"
ELASTIC = Case("elasticity")
# Layers of particles that come to rest on a floor that holds them, and how many such scenes.
LAYERS, LAYER_SPACING, LAYER_SCENES = 3, 0.5 * PAPER.grid_spacing, 4


class Trial(NamedTuple):
    """One switch on a scene where it applies.

    words   the scene
    case    the laws and, where `starts` is None, the scene
    share   length of the run, as a share of the steps asked for
    every   steps between frames
    starts  makes the scenes from the number of particles along an edge
    memory  whether the switch is there for memory, too
    """

    words: str
    case: Case = ELASTIC
    share: float = 1.0
    every: int = 5
    starts: Callable[[int], list[SceneStart]] | None = None
    memory: bool = False


def run_trial(name: str, skips: Skips, edge: int, steps: int, device: torch.device | str = "cpu") -> np.ndarray:
    """What a trial gives with these switches.

    edge     particles along the edge of the body
    steps    see trial_steps
    returns  positions [m] of all frames, (frames, particles, 3)
    """
    trial = TRIALS[name]
    case = replace(trial.case, particles_per_edge=edge)
    starts, laws = trial.starts(edge) if trial.starts else case.starts(), laws_of(case)
    plan, execution = FramePlan(steps, min(trial.every, steps)), Execution(device=device, skips=skips)
    records = simulate_records(starts, laws, plan, execution)
    return np.concatenate([record.position for record in records], axis=1)


def trial_steps(name: str, steps: int) -> int:
    """Steps of a trial when `steps` are asked for."""
    return max(round(TRIALS[name].share * steps), FEWEST_STEPS)


def switched_off(name: str) -> Skips:
    """All switches but that of the trial; none for ALL."""
    return Skips.none() if name == ALL else replace(Skips(), **{name: False})


def _paper_cube(edge: int) -> list[SceneStart]:
    """The paper's cube, let go at 0.15 m above the wall layer."""
    material = material_named("elasticity")
    body = particles(particles_per_edge=edge)
    return [SceneStart("cube", material.name, PAPER, material.defaults, body.position, body.velocity, body.volume)]


def _layers(edge: int) -> list[SceneStart]:
    """Thin layers of an elastic material on a floor that sticks: they shiver for a while and lie still."""
    material, settings = material_named("elasticity"), replace(PAPER, boundary=VERSION_1_STICK)
    places = np.stack(np.meshgrid(*map(np.arange, (edge, LAYERS, edge)), indexing="ij"), axis=-1).reshape(-1, 3)
    corner = (0.5 - 0.5 * LAYER_SPACING * (edge - 1), PAPER.wall_distance + 0.2 * PAPER.grid_spacing)
    position = np.array((corner[0], corner[1], corner[0])) + LAYER_SPACING * places
    volume = np.full(len(position), LAYER_SPACING**3)
    low, high = material.ranges["youngs_modulus"]
    return [
        SceneStart(f"layer-{k}", material.name, settings, material.defaults | {"youngs_modulus": float(stiffness)},
                   position, np.zeros_like(position), volume)
        for k, stiffness in enumerate(np.linspace(low, high, LAYER_SCENES))
    ]  # fmt: skip


TRIALS = {
    "free_fall": Trial("elastic cube, let go at rest, 0.15 m above the wall layer", starts=_paper_cube),
    "grid_window": Trial(
        "elastic cube of 0.2 m in contact, 64 grid nodes", Case("elasticity", grid_nodes=64, side=0.2)
    ),
    "history": Trial("elastic cube in contact, every step kept", every=1, memory=True),
    "rest": Trial(f"{LAYER_SCENES} thin elastic layers on a sticking floor", share=2.0, starts=_layers),
    ALL: Trial("elastic cube, let go at rest, 0.15 m above the wall layer", starts=_paper_cube, memory=True),
}
