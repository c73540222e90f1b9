"""Bodies that fill whole grid cells: particles at the middles of equal parts of a box."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float


class Box(NamedTuple):
    """A box at rest. corner: its lowest corner; sides: its edges [m]."""

    corner: tuple[float, float, float]
    sides: tuple[float, float, float]

    @property
    def middle(self) -> Float[np.ndarray, " 3"]:
        """[m]"""
        return np.asarray(self.corner) + 0.5 * np.asarray(self.sides)


class Lattice(NamedTuple):
    """The particles of a box, z fastest.

    counts    along the three edges
    position  [m], (particles, 3)
    volume    [m^3], (particles,)
    """

    counts: tuple[int, ...]
    position: Float[np.ndarray, "particles 3"]
    volume: Float[np.ndarray, " particles"]


def filled(box: Box, spacing: float) -> Lattice:
    """Particles at the middles of the cubes of edge `spacing` [m] that fill the box, at least one along each edge."""
    counts = tuple(max(1, round(side / spacing)) for side in box.sides)
    axes = [
        low + side * (np.arange(count) + 0.5) / count
        for low, side, count in zip(box.corner, box.sides, counts, strict=True)
    ]
    position = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return Lattice(counts, position, np.full(len(position), np.prod(box.sides) / len(position)))


def block_means(values: Float[np.ndarray, "frames 3 particles"], counts: Sequence[int], blocks: int) -> np.ndarray:
    """Means over blocks x blocks x blocks equal parts of a lattice, (frames, 3, blocks^3).

    The same parts of a body can be compared between lattices of any fineness.
    counts  particles along the edges, each a multiple of `blocks`
    """
    parts = [number for count in counts for number in (blocks, count // blocks)]
    return values.reshape(*values.shape[:2], *parts).mean(axis=(3, 5, 7)).reshape(*values.shape[:2], -1)
