"""Scenes to measure with: cubes that run into the floor, at any number of particles."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
from torch import Tensor

from pcnclaws.geometry.shapes import particles, spin_velocity
from pcnclaws.laws.analytic import Laws, analytic_laws
from pcnclaws.laws.materials import material_named
from pcnclaws.laws.neural import build_neural_laws
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.mpm.state import ParticleState
from pcnclaws.simulation.batch import SceneBatch, batch_scenes
from pcnclaws.simulation.fast_paths import Skips
from pcnclaws.simulation.rollout import differentiable_rollout, state_after
from pcnclaws.simulation.scenes import SceneStart
from pcnclaws.simulation.simulator import Simulator, simulator_of

PAPER = SimulationSettings()
PAPER_NODES = 20  # cells along an edge of its domain
NEURAL_MODEL = {"name": "pcnclaws", "width": 64}
# Contact begins when a particle is within 1.5 cells of a wall node.
REACH = 1.5
# The gradient is that of the positions against those of a body that is stiffer by this factor.
STIFFER = 1.2
FRAME_EVERY = 10
# Nothing of what is timed falls; nor is it asked whether it does.
NO_FALL = Skips(free_fall=False)


@dataclass(frozen=True)
class Case:
    """Scenes of one cube each that meet the floor in the first step at 2 m/s and spin.

    laws                'analytic', or 'neural' for two untrained networks of width 64
    particles_per_edge  on a lattice that includes the faces
    side                [m]
    grid_nodes          the time step is the paper's at 20 and goes with the grid spacing
    """

    material: str
    laws: str = "analytic"
    scenes: int = 1
    particles_per_edge: int = 10
    grid_nodes: int = PAPER_NODES
    side: float = 0.5
    seed: int = 0

    @property
    def particles(self) -> int:
        """Particles of all scenes."""
        return self.scenes * self.particles_per_edge**3

    @property
    def settings(self) -> SimulationSettings:
        """The paper's but for the grid, and the time step of the same CFL number."""
        time_step = PAPER.time_step * PAPER_NODES / self.grid_nodes
        return SimulationSettings(time_step=time_step, grid_spacing=1 / self.grid_nodes)

    def starts(self) -> list[SceneStart]:
        """The scenes at their first contact; direction of flight and spin differ between them."""
        random = np.random.default_rng(self.seed)
        height = PAPER.wall_distance + REACH / self.grid_nodes + 0.5 * self.side
        body = particles("cube", (0.5, height, 0.5), self.side, self.particles_per_edge)
        material = material_named(self.material)
        starts = []
        for number in range(self.scenes):
            drift = np.append(random.uniform(-1.0, 1.0, 2), -2.0)[[0, 2, 1]]
            velocity = spin_velocity(body.position, body.velocity + drift, random.uniform(-3.0, 3.0, 3).tolist())
            name = f"{self.material}-{number}"
            starts.append(
                SceneStart(
                    name,
                    material.name,
                    self.settings,
                    material.defaults,
                    position=body.position,
                    velocity=velocity,
                    volume=body.volume,
                )
            )
        return starts


class Prepared:
    """A case ready to be timed: a simulator and a batch that has gone through `settle` steps of its contact."""

    def __init__(self, case: Case, device: torch.device, settle: int) -> None:
        self.case = case
        self.batch: SceneBatch = batch_scenes(case.starts(), device=device)
        self.simulator = simulator_of(laws_of(case), case.settings).to(device)
        truth = self._analytic()
        self.batch = self.batch._replace(state=_after(truth, self.batch, settle))

    def forward(self, steps: int) -> Callable[[], object]:
        """What runs `steps` steps without a graph."""
        return partial(_after, self.simulator, self.batch, steps)

    def gradient(self, steps: int) -> Callable[[], object]:
        """What runs `steps` steps forward and backward: the gradient of the weights, or of E without any weights.

        The loss is the mean squared difference to the positions of a stiffer body of the analytic law.
        """
        target = self._stiffer_positions(steps)
        parameters = dict(self.batch.parameters)
        weights = list(self.simulator.parameters())
        if not weights:
            parameters["youngs_modulus"] = parameters["youngs_modulus"].clone().requires_grad_()
            weights = [parameters["youngs_modulus"]]

        def work() -> tuple[Tensor, ...]:
            batch = self.batch._replace(parameters=parameters)
            positions = differentiable_rollout(self.simulator, batch, steps, frame_every(steps), skips=NO_FALL)
            return torch.autograd.grad((positions - target).square().mean(), weights, materialize_grads=True)

        return work

    @torch.no_grad()
    def _stiffer_positions(self, steps: int) -> Tensor:
        parameters = self.batch.parameters | {"youngs_modulus": STIFFER * self.batch.parameters["youngs_modulus"]}
        batch = self.batch._replace(parameters=parameters)
        return differentiable_rollout(self._analytic(), batch, steps, frame_every(steps))

    def _analytic(self) -> Simulator:
        simulator = simulator_of(analytic_laws(material_named(self.case.material)), self.case.settings)
        return simulator.to(self.batch.state.position.device)


def laws_of(case: Case) -> Laws:
    """The laws of a case; neural ones as training with its seed starts from them."""
    material = material_named(case.material)
    if case.laws == "analytic":
        return analytic_laws(material)
    torch.manual_seed(case.seed)
    return build_neural_laws(material, NEURAL_MODEL)


def frame_every(steps: int) -> int:
    """Steps between the frames of the loss: a divisor of `steps`."""
    return math.gcd(steps, FRAME_EVERY)


def _after(simulator: Simulator, batch: SceneBatch, steps: int) -> ParticleState:
    """The state `steps` steps later."""
    return state_after(simulator, batch, steps)
