"""Surface of moved particles: a watertight mesh around the volume that they stand for, whatever their arrangement."""

import importlib
from types import ModuleType

import numpy as np
from jaxtyping import Float, Int64
from scipy.ndimage import gaussian_filter

from pcnclaws.errors import UserError, not_installed

# Edges of the cells, and width of the Gaussian that smooths the particles, in spacings: narrower ones show the lattice.
CELL, WIDTH = 0.5, 0.6
# Where the share of volume that is filled is one half lies the flat surface of a body.
LEVEL = 0.5
MOST_CELLS = 100_000_000

Vertices = Float[np.ndarray, "vertices 3"]
Triangles = Int64[np.ndarray, "faces 3"]


def require_marching_cubes() -> ModuleType:
    """The module of scikit-image; UserError with the way to install it where it is missing."""
    try:
        return importlib.import_module("skimage.measure")
    except ImportError as error:
        raise not_installed("surface=true", "scikit-image", "surface", "surface=false") from error


def reconstructed_surface(
    position: Float[np.ndarray, "particles 3"], volume: Float[np.ndarray, " particles"]
) -> tuple[Vertices, Triangles]:
    """Vertices [m] and triangles, counterclockwise seen from outside, of the surface around particles.

    It is where half of the volume is filled, of particles that are smoothed by a Gaussian: edges and corners are round,
    and a particle that stands alone is not part of it.

    position  [m]
    volume    that each stands for [m^3]
    raises    UserError without scikit-image, for particles too far apart for a grid, and for those with no inside
    source    Lewiner et al. 2003, "Efficient implementation of marching cubes' cases with topological guarantees"
    """
    measure = require_marching_cubes()
    spacing = float(np.cbrt(np.median(volume)))
    filled, origin, cell = _filled_share(position, volume, spacing)
    if not filled.max() > LEVEL:
        raise UserError("surface=true: the particles are too far apart to have a surface; accepted: surface=false")
    vertices, faces, _, _ = measure.marching_cubes(filled, LEVEL, spacing=(cell,) * 3, gradient_direction="ascent")
    return vertices.astype(np.float64) + origin, faces.astype(np.int64)


def _filled_share(position: np.ndarray, volume: np.ndarray, spacing: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Share of volume that is filled at the nodes of a grid [-], (x, y, z), its origin [m], and its cells' edge [m]."""
    cell = CELL * spacing
    margin = 2 + int(np.ceil(4.0 * WIDTH / CELL))
    low = np.floor(position.min(0) / cell) - margin
    counts = np.ceil(position.max(0) / cell) + margin + 2 - low
    if float(np.prod(counts)) > MOST_CELLS:
        raise UserError(
            f"surface=true: the particles spread over {np.prod(counts):.0e} cells of half their spacing; accepted: at "
            f"most {MOST_CELLS:.0e}, or surface=false"
        )
    shape = tuple(counts.astype(int))
    nodes = position / cell - low
    base = np.floor(nodes).astype(np.int64)
    beyond = nodes - base
    filled = np.zeros(shape, np.float32)
    # each particle is shared by the eight nodes around it
    for corner in np.ndindex(2, 2, 2):
        share = np.where(np.array(corner) == 1, beyond, 1.0 - beyond).prod(1) * volume / cell**3
        np.add.at(filled, tuple((base + corner).T), share)
    # sharing has widened the particles by a variance of cell^2 / 6
    width = np.sqrt((WIDTH / CELL) ** 2 - 1.0 / 6.0)
    return gaussian_filter(filled, width, mode="constant", truncate=4.0), low * cell, cell
