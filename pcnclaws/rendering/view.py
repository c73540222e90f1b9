"""From a domain of any size and place to the unit box that pictures show."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from pcnclaws.mpm.settings import UNIT_BOX
from pcnclaws.simulation.records import SceneRecord

# Without bounds the picture shows what particles reach, and this part of it more.
MARGIN = 0.1


@dataclass(frozen=True)
class View:
    """A cube of space: its lower corner and its edge [m], which is the unit of length of the picture."""

    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    edge: float = 1.0

    def of(self, position: Float[np.ndarray, "*frames 3"]) -> Float[np.ndarray, "*frames 3"]:
        """Positions [m] in the cube, in its units."""
        return position if self == UNIT_VIEW else (position - np.array(self.origin)) / self.edge


UNIT_VIEW = View()


def view_of(records: Sequence[SceneRecord]) -> View:
    """The cube about the domain of the first record, or about all motions where it has no bounds.

    The side of it that gravity points to is that of the domain.
    """
    settings = records[0].settings
    if settings.domain == UNIT_BOX:
        return UNIT_VIEW
    if settings.domain is None:
        places = [record.position.reshape(-1, 3) for record in records]
        low = np.min([np.nanmin(place, axis=0) for place in places], axis=0).astype(np.float64)
        high = np.max([np.nanmax(place, axis=0) for place in places], axis=0).astype(np.float64)
        room = max(MARGIN * float((high - low).max()), settings.grid_spacing)
        low, high = low - room, high + room
    else:
        low, high = (np.array(corner) for corner in settings.domain)
    edge = float((high - low).max())
    origin = 0.5 * (low + high) - 0.5 * edge
    axis = int(np.abs(settings.gravity).argmax())
    if settings.gravity[axis] < 0.0:
        origin[axis] = low[axis]
    elif settings.gravity[axis] > 0.0:
        origin[axis] = high[axis] - edge
    x, y, z = origin.tolist()
    return View((x, y, z), edge)
