"""The beam of Dubied et al. as a scene: a sticky clamp, gravity, a weight on its tip; and what its tip does."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

import pcnclaws as pc
from benchmarks.real_beam.law import RELAXATION_TIMES, SILICONE, STRENGTHS

LENGTH, WIDTH, DENSITY, GRAVITY = 0.1, 0.03, 1070.0, 9.81
LAW = pc.analytic_law(SILICONE)
# Layers of cells within the clamp, and a part of the beam next to its tip that moves as one piece.
CELLS_WITHIN, END = 2, 0.012
# Affine XPIC of order 2, which damps the beam a fifth as much as APIC.
TRANSFER = "axpic2"


@dataclass(frozen=True)
class Beam:
    """The beam along z, held for z <= 0; x points up.

    cells           of the grid over its width; two particles along the edge of a cell
    youngs_modulus  in the long term [Pa]
    strengths       moduli of the Maxwell elements over the long-term one [-]
    weight          mass that hangs on the lower edge of the tip [kg]
    """

    cells: int
    youngs_modulus: float
    poissons_ratio: float = 0.45
    strengths: tuple[float, ...] = (0.0,) * len(RELAXATION_TIMES)
    weight: float = 0.0

    @property
    def spacing(self) -> float:
        """dx [m]."""
        return WIDTH / self.cells

    def body(self) -> pc.Body:
        """Its particles; those on the lower edge of the tip carry the weight."""
        within, half = CELLS_WITHIN * self.spacing, 0.5 * WIDTH
        along = round(2.0 * (LENGTH + within) / self.spacing)
        low, high = (-half, -half, -within), (half, half, LENGTH)
        axes = [
            a + (b - a) * (np.arange(n) + 0.5) / n
            for a, b, n in zip(low, high, (2 * self.cells, 2 * self.cells, along), strict=True)
        ]
        position = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        volume = WIDTH**2 * (LENGTH + within) / len(position)
        density = np.full(len(position), DENSITY)
        edge = (position[:, 0] < axes[0][0] + 1e-9) & (position[:, 2] > axes[2][-1] - 1e-9)
        density[edge] += self.weight / (volume * edge.sum())
        return pc.Body.points(torch.from_numpy(position), volume, torch.from_numpy(density))

    def scene(self, time_step: float | str = "auto") -> pc.Scene:
        """The beam, straight and at rest, let go at time 0."""
        clamp = pc.Collider.box(low=(-1.0, -1.0, -1.0), high=(1.0, 1.0, 0.0), contact="sticky")
        settings = pc.Settings(
            domain=None,
            grid_spacing=self.spacing,
            gravity=(-GRAVITY, 0.0, 0.0),
            time_step=time_step,
            transfer=TRANSFER,
        )
        parameters: dict[str, Any] = {
            "youngs_modulus": self.youngs_modulus,
            "poissons_ratio": self.poissons_ratio,
        } | {one.name: value for one, value in zip(STRENGTHS, self.strengths, strict=True)}
        return pc.Scene(self.body(), LAW, colliders=[clamp], settings=settings, **parameters)


@dataclass(frozen=True)
class Tip:
    """The motion of the end of a beam as that of one piece.

    time      [s], from the release on, (frames,)
    middle    of the tip's face [m], (frames, 3)
    gradient  of the place with respect to the undeformed one [-], (frames, 3, 3)
    """

    time: np.ndarray
    middle: np.ndarray
    gradient: np.ndarray

    def displacement(self, place: np.ndarray) -> np.ndarray:
        """Of points that move with the tip [m], from their undeformed places (points, 3); (frames, points, 3)."""
        offset = place - np.array((0.0, 0.0, LENGTH))
        return self.middle[:, None] + np.einsum("fij,pj->fpi", self.gradient, offset) - place

    @property
    def height(self) -> np.ndarray:
        """Of the middle of the tip's face above its start [m]."""
        return self.middle[:, 0]


def swing(beams: Sequence[Beam], duration: float, interval: float = 0.002) -> list[Tip]:
    """The motions of beams on one grid, as one batch with the shortest of their time steps.

    duration, interval  of the motion and between its frames [s]
    """
    step = min(beam.scene().time_step for beam in beams)
    every = max(int(interval / step), 1)
    time_step = interval / (every + (interval / every > step))
    every = round(interval / time_step)
    scenes = [beam.scene(time_step) for beam in beams]
    motions = pc.simulate_scenes(scenes, every * round(duration / interval), every, dtype=torch.float32)
    return [_tip_of(scene.body, motion) for scene, motion in zip(scenes, motions, strict=True)]


def _tip_of(body: pc.Body, motion: pc.Motion) -> Tip:
    start = body.position.numpy()
    end = start[:, 2] > LENGTH - END
    offset = start[end] - np.array((0.0, 0.0, LENGTH))
    found = motion.position.double().numpy()[:, end]
    linear = np.linalg.pinv(np.column_stack((np.ones(end.sum()), offset)))
    fitted = np.einsum("kp,fpi->fki", linear, found)
    return Tip(motion.time.double().numpy(), fitted[:, 0], np.swapaxes(fitted[:, 1:], 1, 2))
