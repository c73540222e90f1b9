"""One scene, simulated with the settings that a comparison of run time and error varies, and timed."""

import copy
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float

from benchmarks.cell_lattices import Box, Lattice, filled
from benchmarks.yardstick import seconds
from pcnclaws.compiled.backend import using_backend
from pcnclaws.laws.analytic import Laws
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.mpm.state import ParticleState
from pcnclaws.simulation.batch import SceneBatch, batch_scenes
from pcnclaws.simulation.fast_paths import Skips
from pcnclaws.simulation.recording import FramePlan, Trajectory
from pcnclaws.simulation.rollout import simulate_scenes
from pcnclaws.simulation.scenes import SceneStart
from pcnclaws.simulation.simulator import simulator_of

PAPER = SimulationSettings()
PAPER_NODES = 20  # cells along an edge of its domain
PRECISIONS = {"float32": torch.float32, "float64": torch.float64}
# A run shorter than this [s] is timed several times.
SHORT, SAMPLES = 1.0, 3


@dataclass(frozen=True)
class Resolution:
    """How finely and by what a scene is simulated.

    per_cell     particles along the edge of a grid cell
    time_factor  the time step is the paper's at 20 nodes, goes with the grid spacing, and is longer by this factor
    skips        whether what a scene does not need is skipped
    """

    grid_nodes: int
    per_cell: int
    time_factor: float
    precision: str = "float32"
    skips: bool = True
    backend: str = "auto"

    @property
    def name(self) -> str:
        """In words, for rows of results and the progress."""
        skips = "" if self.skips else ", no skips"
        return (
            f"{self.grid_nodes} nodes, {self.per_cell} particles a cell edge, time step x {self.time_factor:g}, "
            f"{self.precision}, {self.backend}{skips}"
        )

    def steps_between(self, interval: float) -> int:
        """Steps between frames: a whole number, so that the frames of all resolutions are of the same times."""
        spaced = PAPER.time_step * PAPER_NODES / self.grid_nodes
        return max(1, round(interval / (spaced * self.time_factor)))

    def lattice(self, box: Box) -> Lattice:
        """The particles of a body."""
        return filled(box, 1.0 / (self.grid_nodes * self.per_cell))


class Scenario(ABC):
    """A motion to simulate: one body that is looked at `frames` times, equally spaced, within `duration` [s]."""

    box: Box
    duration: float
    frames: int

    @abstractmethod
    def start(self, lattice: Lattice, resolution: Resolution) -> SceneStart:
        """The start, with the particles of `lattice`."""

    def settings(
        self, resolution: Resolution, gravity: tuple[float, float, float], wall_distance: float
    ) -> SimulationSettings:
        """The settings at a resolution."""
        interval = self.duration / self.frames
        time_step = interval / resolution.steps_between(interval)
        return SimulationSettings(time_step, 1 / resolution.grid_nodes, wall_distance, gravity)


class TimedRun(NamedTuple):
    """A run and the seconds it took. final: the state of the last frame."""

    resolution: Resolution
    settings: SimulationSettings
    lattice: Lattice
    batch: SceneBatch
    position: Float[np.ndarray, "frames 3 particles"]
    final: ParticleState
    steps: int
    seconds: float


def timed_run(scenario: Scenario, laws: Laws, resolution: Resolution, device: torch.device) -> TimedRun:
    """Simulates a scenario without gradients; frames without the start, in double precision.

    raises  SimulationDiverged
    """
    lattice = resolution.lattice(scenario.box)
    start = scenario.start(lattice, resolution)
    batch = batch_scenes([start], PRECISIONS[resolution.precision], device)
    skips = Skips() if resolution.skips else Skips.none()
    simulator = copy.deepcopy(simulator_of(laws, start.settings, skips))
    simulator = simulator.to(device=device, dtype=PRECISIONS[resolution.precision])
    every = resolution.steps_between(scenario.duration / scenario.frames)
    steps = every * scenario.frames

    def run(plan: FramePlan) -> Trajectory:
        return simulate_scenes(simulator, batch, plan, skips)

    with using_backend(resolution.backend):
        run(FramePlan(1))  # compiles, starts threads
        trajectory, taken = _timed(lambda: run(FramePlan(steps, every, keyframe_every=steps)), device)
    position = trajectory.position[1:].double().cpu().numpy()
    return TimedRun(resolution, start.settings, lattice, batch, position, _final(trajectory), steps, taken)


def _timed(run: Callable[[], Trajectory], device: torch.device) -> tuple[Trajectory, float]:
    """The trajectory and the seconds of the fastest run; a short one is run several times."""
    found: dict[str, Trajectory] = {}

    def call() -> None:
        found["trajectory"] = run()

    samples = [seconds(call, device)]
    while samples[0] < SHORT and len(samples) < SAMPLES:
        samples.append(seconds(call, device))
    return found["trajectory"], min(samples)


def _final(trajectory: Trajectory) -> ParticleState:
    return ParticleState(
        trajectory.position[-1], trajectory.keyframe_velocity[-1], trajectory.affine[-1], trajectory.deformation[-1]
    )


def cost_of_run(run: TimedRun, duration: float) -> dict[str, object]:
    """Size and run time of a run of so many simulated seconds, as plain values."""
    return {
        "time_step": run.settings.time_step,
        "particles": len(run.lattice.volume),
        "steps": run.steps,
        "seconds": run.seconds,
        "seconds_per_simulated_second": run.seconds / duration,
    }
