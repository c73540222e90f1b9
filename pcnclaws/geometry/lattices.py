"""The lattice of a body along one axis: where its particles stand between the faces.

centres  in the middle of equal cells, so that each particle stands for the material around it
faces    the outermost ones on the faces, as in the paper: they carry the mass of a whole cell each, and a cube of n
         an edge answers as if it were n / (n - 1) times as long
"""

import numpy as np
from jaxtyping import Float

LATTICES = ("centres", "faces")
# Accepted rounding of an edge that holds a whole number of spacings, relative.
ROUNDING = 1e-5


def lattice_points(extent: float, per_edge: int, lattice: str) -> Float[np.ndarray, " points"]:
    """Coordinates about 0 along an edge of a box whose longest edge is 1 and holds `per_edge` points.

    extent   length of this edge [-], from 0 to 1
    lattice  one of LATTICES
    """
    if lattice == "centres":
        cells = max(int(extent * per_edge * (1.0 + ROUNDING) + 0.5), 1)
        return (np.arange(cells) + 0.5 - 0.5 * cells) / per_edge
    gaps = int(extent * (per_edge - 1) * (1.0 + ROUNDING))
    reach = 0.5 * gaps / (per_edge - 1)
    return np.linspace(-reach, reach, gaps + 1)
