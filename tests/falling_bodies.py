"""Bodies of 27 particles in a coarse grid, for tests of what a scene does not need."""

from collections.abc import Sequence

import numpy as np
import torch
from bodies import EARTH, joined, lattice, per_particle

from pcnclaws.laws.analytic import Laws, analytic_laws
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.laws.neural import build_neural_laws
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.mpm.state import ParticleState, Scenes
from pcnclaws.simulation.batch import SceneBatch
from pcnclaws.simulation.fast_paths import Skips
from pcnclaws.simulation.recording import FramePlan, Trajectory
from pcnclaws.simulation.rollout import simulate_scenes
from pcnclaws.simulation.simulator import Simulator, simulator_of

SETTINGS = SimulationSettings(time_step=1e-3, grid_spacing=1 / 12)
PARTICLES, SIDE = 27, 0.2
ON, OFF = Skips(), Skips.none()


# A batch with the parameters of its material.
Bodies = SceneBatch


def body(centre: tuple[float, float, float], velocity: Sequence[float] | np.ndarray) -> ParticleState:
    """A cube in its rest shape that moves as one."""
    position = lattice((3, 3, 3), (SIDE, SIDE, SIDE), centre)
    same_velocity = torch.as_tensor(velocity, dtype=torch.float64)[:, None].repeat(1, PARTICLES)
    return ParticleState.at_rest_shape(position, same_velocity)


def batch(
    *states: ParticleState, material: str = "elasticity", gravity: Sequence[Sequence[float] | np.ndarray] | None = None
) -> Bodies:
    """The bodies, each a scene of its own, float64."""
    count = len(states) * PARTICLES
    volume = torch.full((count,), SIDE**3 / PARTICLES, dtype=torch.float64)
    index = torch.arange(len(states)).repeat_interleave(PARTICLES)
    down = torch.tensor(np.array(gravity or [EARTH] * len(states)), dtype=torch.float64).T.contiguous()
    parameters = per_particle(MATERIALS[material].defaults, count)
    return Bodies(joined(*states), Scenes(index, 1000.0 * volume, volume, down), parameters)


def three_falls(material: str = "elasticity") -> Bodies:
    """Bodies that meet the floor early, late, and not within 100 steps."""
    early, late = body((0.5, 0.36, 0.5), (0.3, -2.0, 0.1)), body((0.45, 0.42, 0.5), (0.0, -1.2, 0.0))
    return batch(early, late, body((0.5, 0.7, 0.5), (0.0, -0.5, 0.0)), material=material)


def analytic(material: str = "elasticity", settings: SimulationSettings = SETTINGS) -> Simulator:
    return simulator(analytic_laws(MATERIALS[material]), settings)


def neural(material: str, model: str = "pcnclaws") -> Simulator:
    """Networks of random weights, float64."""
    torch.manual_seed(0)
    made = simulator(build_neural_laws(MATERIALS[material], {"name": model, "width": 8}))
    with torch.no_grad():
        for weight in made.parameters():
            weight += 0.05 * torch.randn_like(weight)
    return made


def simulator(laws: Laws, settings: SimulationSettings = SETTINGS) -> Simulator:
    return simulator_of(laws, settings).double()


def run(simulator: Simulator, bodies: Bodies, plan: FramePlan, skips: Skips = ON) -> Trajectory:
    return simulate_scenes(simulator, bodies, plan, skips)


def same(a: Trajectory, b: Trajectory, tolerance: float) -> bool:
    """Whether two runs recorded the same, C and F to the tolerance times the frequency of steps."""
    if not all(torch.equal(a[field], b[field]) for field in (0, 3)):
        return False
    pairs = [(a[field], b[field]) for field in (1, 2, 4, 5, 6)]
    return all(x.shape == y.shape and bool(((x - y).abs() <= tolerance * (1 + y.abs())).all()) for x, y in pairs)
