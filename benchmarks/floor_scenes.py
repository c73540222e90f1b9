"""Scenes on the floor without a known answer: a simulation is compared with a finer one of the same law."""

import math
from abc import abstractmethod

import numpy as np
from jaxtyping import Float

from benchmarks.cell_lattices import Box, Lattice, block_means
from benchmarks.timed_runs import PAPER, Resolution, Scenario, TimedRun
from pcnclaws.laws.materials import material_named
from pcnclaws.simulation.scenes import SceneStart

SIDE = 0.5
# Bodies are compared by the mean positions of 5 x 5 x 5 equal parts of them.
BLOCKS = 5
# The walls lie at 0.1 m: on a node when the domain has a multiple of this many, which the blocks fit into, too.
NODES_STEP = 10


class FloorScene(Scenario):
    """A cube of the paper's size in the paper's domain, of a material with the middle of its parameters.

    compared  how many of the last frames are compared
    """

    name: str
    compared: int

    def __init__(self, material: str) -> None:
        self.material = material_named(material)

    @abstractmethod
    def motion(self, lattice: Lattice) -> tuple[Float[np.ndarray, "particles 3"], Float[np.ndarray, "particles 3 3"]]:
        """Start velocity [m/s] and its gradient [1/s]."""

    def start(self, lattice: Lattice, resolution: Resolution) -> SceneStart:
        """The start, undeformed."""
        settings = self.settings(resolution, PAPER.gravity, PAPER.wall_distance)
        velocity, affine = self.motion(lattice)
        return SceneStart(
            self.name,
            self.material.name,
            settings,
            self.material.defaults,
            lattice.position,
            velocity,
            lattice.volume,
            affine,
        )

    def means(self, run: TimedRun) -> Float[np.ndarray, "frames 3 blocks"]:
        """Mean positions of the parts of the body at the compared frames [m]."""
        return block_means(run.position[-self.compared :], run.lattice.counts, BLOCKS)

    @staticmethod
    def errors(means: np.ndarray, reference: np.ndarray) -> dict[str, float]:
        """{"error", "centre_error"}, in units of the side of the cube.

        error         root mean square distance of the parts of the body from where they are in the reference
        centre_error  the same of the centre of mass
        """
        difference = means - reference
        return {
            "error": math.sqrt(np.square(difference).sum(1).mean()) / SIDE,
            "centre_error": math.sqrt(np.square(difference.mean(2)).sum(1).mean()) / SIDE,
        }


class SoftBounce(FloorScene):
    """A cube that stands on the floor, is pressed down smoothly, and jumps.

    It starts in the shape of its first vibration on the floor, v = -V sin(pi y / (2 L)): nothing is discontinuous, and
    the floor is met from the first step on.
    """

    name = "bounce"
    box = Box((0.25, PAPER.wall_distance, 0.25), (SIDE, SIDE, SIDE))
    duration = 0.12
    frames = compared = 4
    speed = 1.0

    def motion(self, lattice: Lattice) -> tuple[np.ndarray, np.ndarray]:
        k = 0.5 * math.pi / SIDE
        phase = k * (lattice.position[:, 1] - self.box.corner[1])
        velocity, affine = np.zeros_like(lattice.position), np.zeros((len(phase), 3, 3))
        velocity[:, 1], affine[:, 1, 1] = -self.speed * np.sin(phase), -self.speed * k * np.cos(phase)
        return velocity, affine


class Drop(FloorScene):
    """The paper's cube: falls 0.15 m and bounces. Compared once it has met the floor.

    A body feels the floor 1.5 cells before it is there.
    """

    name = "drop"
    box = Box((0.25, 0.25, 0.25), (SIDE, SIDE, SIDE))
    duration = 0.24
    frames, compared = 8, 3

    def motion(self, lattice: Lattice) -> tuple[np.ndarray, np.ndarray]:
        return np.zeros_like(lattice.position), np.zeros((len(lattice.position), 3, 3))


FLOOR_SCENES: dict[str, type[FloorScene]] = {"drop": Drop, "bounce": SoftBounce}
