"""Particle spacing of a body beside the cells of the grid that carries it."""

import logging
from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float

from pcnclaws.mpm.settings import FEWEST_CELLS, SimulationSettings
from pcnclaws.simulation.scenes import SceneStart

log = logging.getLogger(__name__)

# Of so many particles the neighbours are looked for.
SAMPLE = 2000
# So many particles are compared one with the other, in less time than SciPy takes to load.
FEW = 2000
# Accepted rounding of a spacing of one cell, relative.
ROUNDING = 1e-3


def particle_spacing(position: Float[np.ndarray, "particles 3"], volume: Float[np.ndarray, " particles"]) -> float:
    """Distance of neighbouring particles [m]: the edge of the cube that one stands for, or, if larger, the median one.

    position  at the start [m]
    volume    [m^3]
    """
    edge = float(np.mean(volume) ** (1.0 / 3.0))
    if len(position) < 2:
        return edge
    sample = position[:: -(-len(position) // SAMPLE)]
    return max(edge, float(np.median(_to_the_nearest(sample, position))))


def particles_a_cell(start: SceneStart) -> float:
    """Number of particles in a cell of the grid [-]."""
    return (start.settings.grid_spacing / particle_spacing(start.position, start.volume)) ** 3


def warn_of_sparse_particles(starts: Sequence[SceneStart]) -> None:
    """One line where the particles of a scene are more than a cell apart: it breaks without a law of fracture."""
    sparse = [start for start in starts if particles_a_cell(start) < 1.0 - 3.0 * ROUNDING]
    if not sparse:
        return
    start = sparse[0]
    dx, spacing = start.settings.grid_spacing, particle_spacing(start.position, start.volume)
    others = f" (and {len(sparse) - 1} more)" if len(sparse) > 1 else ""
    log.warning(
        "scene '%s'%s: its particles are %.3g cells apart (%.3g m), %.2g a cell: with less than 1 a cell a body breaks "
        "apart without a law of fracture; advised: at most %.3g m, better %.3g m (scene.particles_per_edge), or a "
        "coarser grid (simulation.grid_spacing=%.3g)",
        start.name,
        others,
        spacing / dx,
        spacing,
        particles_a_cell(start),
        dx,
        0.5 * dx,
        _coarser_spacing(start.settings, spacing),
    )


def _to_the_nearest(
    sample: Float[np.ndarray, "sample 3"], position: Float[np.ndarray, "particles 3"]
) -> Float[np.ndarray, " sample"]:
    """Distance of some of the particles to the nearest other one [m]."""
    if len(position) <= FEW:
        pairs = torch.as_tensor(np.array(sample, np.float64)), torch.as_tensor(np.array(position, np.float64))
        return torch.cdist(*pairs, compute_mode="donot_use_mm_for_euclid_dist").kthvalue(2, dim=1).values.numpy()
    from scipy.spatial import KDTree

    return KDTree(position).query(sample, k=2)[0][:, 1]


def _coarser_spacing(settings: SimulationSettings, least: float) -> float:
    """The smallest spacing of a grid that fits the domain and is not below another one [m]."""
    if settings.domain is None:
        return least
    edge = min(high - low for low, high in zip(*settings.domain, strict=True))
    return edge / max(int(edge / least + ROUNDING), FEWEST_CELLS)
