"""Bodies, settings and measures that the cases of motion share."""

import math
from collections.abc import Sequence

import numpy as np
import torch

import pcnclaws as pc

NO_GRAVITY = (0.0, 0.0, 0.0)
Vector = Sequence[float]


def box(low: Vector, sides: Vector, counts: Sequence[int]) -> pc.Body:
    """A box of particles in the centres of equal cells: lower corner and edges [m], particles along each edge."""
    axes = [a + side * (np.arange(n) + 0.5) / n for a, side, n in zip(low, sides, counts, strict=True)]
    position = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return pc.Body.points(torch.from_numpy(position), float(np.prod(sides)) / len(position))


def at_walls(sides: Vector, spacing: float, room: Vector = (0.0, 0.0, 0.0)) -> tuple[Vector, tuple[Vector, Vector]]:
    """Lower corner of a body and the domain of one whose walls touch it, one cell thick, with room above it.

    sides  edges of the body [m], whole numbers of cells
    """
    cells = [max(round((side + free) / spacing), 2) + 2 for side, free in zip(sides, room, strict=True)]
    return 3 * [spacing], (3 * [0.0], [n * spacing for n in cells])


def steps_of(duration: float, time_step: float) -> tuple[int, float]:
    """A whole number of steps of at most this length, and their length [s]."""
    steps = math.ceil(duration / time_step * (1.0 - 1e-9))
    return steps, duration / steps


def deformation_of(motion: pc.Motion) -> torch.Tensor:
    """The deformation gradients of a motion that was asked for them, (frames, particles, 3, 3)."""
    if motion.deformation is None:
        raise ValueError("the motion has no deformation gradients")
    return motion.deformation


def affine_of(motion: pc.Motion) -> np.ndarray:
    """The affine velocities C [1/s] of a motion that was asked for deformation gradients, (frames, particles, 3, 3)."""
    if motion.record.keyframes is None:
        raise ValueError("the motion has no restart states")
    return motion.record.keyframes.affine


def array(values: torch.Tensor) -> np.ndarray:
    """A tensor as an array in double precision."""
    return values.detach().double().cpu().numpy()


def period_of(time: np.ndarray, signal: np.ndarray) -> float:
    """The period of an oscillation about 0 [s], from its first to its last crossing of 0, between frames by a line."""
    before = np.nonzero(np.sign(signal[:-1]) * np.sign(signal[1:]) < 0)[0]
    share = signal[before] / (signal[before] - signal[before + 1])
    crossing = time[before] + share * (time[before + 1] - time[before])
    return float(2.0 * (crossing[-1] - crossing[0]) / (len(crossing) - 1))
