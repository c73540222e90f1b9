"""Training windows of a graph network: short pieces of recorded motions, with noise, and what came next."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.utils.data import Dataset

from pcnclaws.baselines.graphs import Graph, graph_of, joined
from pcnclaws.errors import UserError
from pcnclaws.mpm.settings import Domain, SimulationSettings
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.simulation.scenes import SceneStart, start_of

# Frames that the network sees: five velocities.
FRAMES = 6
# A graph of more particles is more than a step of training should hold.
MOST_PARTICLES = 2000

Positions = Float[np.ndarray, "frames particles 3"]


class Windows(NamedTuple):
    """A batch: the graph, and the true change of the velocity to the next frame [m], (particles, 3).

    The velocities of the graph carry noise; the change leads from them to the true velocity and to the true position
    displaced by the noise of the last one.
    """

    graph: Graph
    change: Float[Tensor, "particles 3"]


class RecordedMotion(NamedTuple):
    """The frames of a scene with those before its start.

    position    [m], (FRAMES - 1 + frames, particles, 3)
    parameters  standardised, (names,)
    walls       lower and upper corner of the space between the walls [m]
    """

    position: Positions
    parameters: Float[Tensor, " names"]
    walls: Domain


class WindowDataset(Dataset[Windows]):
    """Batch i of a training, a pure function of the seed and i."""

    def __init__(
        self,
        motions: Sequence[RecordedMotion],
        count: int,
        batch: int,
        *,
        noise: float,
        seed: int,
        unit: Tensor,
        radius: float,
    ) -> None:
        self.motions, self.count, self.batch = list(motions), count, batch
        self.noise, self.seed, self.unit, self.radius = noise, seed, unit.clone(), radius

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, iteration: int) -> Windows:
        random = np.random.default_rng((self.seed, iteration))
        graphs, changes = [], []
        for _ in range(self.batch):
            motion = self.motions[int(random.integers(len(self.motions)))]
            first = int(random.integers(len(motion.position) - FRAMES))
            window = motion.position[first : first + FRAMES + 1].astype(np.float64)
            noise = random_walk(random, self.noise, (FRAMES, *window.shape[1:]))
            seen = window[:FRAMES] + noise
            change = window[-1] + noise[-1] - 2.0 * seen[-1] + seen[-2]
            graphs.append(graph_of(torch.from_numpy(seen), motion.walls, motion.parameters, self.unit, self.radius))
            changes.append(torch.from_numpy(change).float())
        return Windows(joined(graphs), torch.cat(changes))


def random_walk(random: np.random.Generator, deviation: float, shape: tuple[int, ...]) -> np.ndarray:
    """Noise on positions [m] whose velocity is a random walk, as that of a rollout is; shape (frames, particles, 3).

    deviation  standard deviation of the velocity of the last frame [m per frame]
    source     Sanchez-Gonzalez et al. 2020, where it is the noise of the training
    """
    steps = shape[0] - 1
    velocity = (deviation / np.sqrt(steps)) * random.standard_normal((steps, *shape[1:])).cumsum(0)
    return np.concatenate((np.zeros((1, *shape[1:])), velocity.cumsum(0)))


def before_start(start: SceneStart, frame_time: float) -> Positions:
    """Positions [m] of the FRAMES - 1 frames before a start, as if the particles had come there in free flight.

        x_(-n) = x_0 - n dt v_0 + dt^2 n (n - 1) / 2 g,

    the free flight of the simulation's own steps dt, backwards.
    """
    settings = start.settings
    time = frame_time * np.arange(FRAMES - 1, 0, -1.0)[:, None, None]
    gravity = np.array(settings.gravity)
    flight = 0.5 * time * (time - settings.time_step) * gravity
    return start.position - time * start.velocity + flight


def recorded_motion(record: SceneRecord, parameters: Tensor, frame_time: float) -> RecordedMotion:
    """A recorded scene for training; UserError where its frames are not all there, or it has too many particles."""
    if record.position.shape[1] > MOST_PARTICLES:
        raise UserError(
            f"{record.label} has {record.position.shape[1]} particles; model=gns trains on at most {MOST_PARTICLES}"
        )
    if not np.isfinite(record.position).all():
        raise UserError(f"{record.label} has particles that were not observed; model=gns needs all of them")
    position = np.concatenate((before_start(start_of(record), frame_time), record.position))
    return RecordedMotion(position, parameters, walls_alone(record.settings, record.label))


def walls_alone(settings: SimulationSettings, where: str) -> Domain:
    """Lower and upper corner of the space between the walls [m], which are all that a graph network sees of a scene.

    raises  UserError for a scene with colliders or loads
    """
    if settings.colliders or settings.loads:
        raise UserError(f"{where} has colliders or loads, which model=gns does not see; accepted: bodies between walls")
    return settings.within(settings.wall_distance)
