"""Observations of a small cube that hits the floor, and the problems of explaining them."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import torch
from recorded_scenes import small_cube

from pcnclaws.data.observation import Observation
from pcnclaws.data.observation_files import from_record
from pcnclaws.estimation.levenberg_marquardt import LevenbergMarquardt
from pcnclaws.estimation.problem import EstimationProblem, Linearisation
from pcnclaws.estimation.unknowns import Unknowns, components_of, make_unknowns
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.simulation.execution import Execution
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.scenes import SceneStart

TRUTH = {
    "elasticity": {"youngs_modulus": 1e5, "poissons_ratio": 0.25},
    "plasticine": {"youngs_modulus": 3e5, "poissons_ratio": 0.3, "yield_stress": 2e3},
    "sand": {"youngs_modulus": 3e5, "poissons_ratio": 0.2, "friction_angle": 30.0},
}


def start(material: str, velocity: tuple[float, float, float] = (0.5, -2.0, 0.0), **truth: float) -> SceneStart:
    return replace(small_cube(material, material, velocity), parameters=TRUTH[material] | truth)


def observed(scene: SceneStart, steps: int = 120, every: int = 10, dtype: torch.dtype = torch.float32) -> Observation:
    laws = analytic_laws(MATERIALS[scene.material])
    return from_record(simulate_records([scene], laws, FramePlan(steps, every), Execution(dtype))[0])


def unknowns_of(
    observation: Observation,
    fixed: Mapping[str, float] | None = None,
    vary: str = "uniform",
    motion: bool = False,
    time_offset: bool = False,
    surroundings: Sequence[str] = (),
) -> Unknowns:
    parts = components_of(vary, observation.position, observation.spacing)
    bodies = parts if vary == "bodies" else components_of("uniform", observation.position, observation.spacing)
    names = MATERIALS[observation.material].parameter_names
    return make_unknowns(
        names, fixed or {}, parts, bodies, motion=motion, time_offset=time_offset, **dict.fromkeys(surroundings, True)
    )


def problem_of(
    observation: Observation, unknowns: Unknowns | None = None, dtype: torch.dtype = torch.float32
) -> EstimationProblem:
    laws = analytic_laws(MATERIALS[observation.material])
    return EstimationProblem(laws, observation, unknowns or unknowns_of(observation), Execution(dtype))


def solved(
    problem: EstimationProblem, guess: Sequence[float], iterations: int = 25
) -> tuple[np.ndarray, Linearisation]:
    """Coordinates and linearisation at the end of a search."""
    u, search = problem.unknowns.coordinates(guess), LevenbergMarquardt()
    here = problem.linearise(u)
    for _ in range(iterations):
        step = search.step(here, problem.unknowns.reach(u))
        there = problem.linearise(u + step)
        if search.judge(here.mse, there.mse, step):
            u, here = u + step, there
        if search.done:
            break
    return u, here
