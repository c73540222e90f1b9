"""Placement of particles: they belong into the domain and outside its walls."""

import numpy as np
from jaxtyping import Float

from pcnclaws.errors import UserError
from pcnclaws.mpm.diagnostics import place_outside
from pcnclaws.mpm.settings import SimulationSettings

# Accepted rounding of a position on the surface of the wall layer [m].
WALL_TOLERANCE = 1e-6


def require_inside(
    position: Float[np.ndarray, "particles 3"], settings: SimulationSettings, what: str, slack: float = 0.0
) -> None:
    """Refuses particles outside the domain or inside the wall layer with a UserError that names the first one.

    what   the scene or the option in the error message
    slack  accepted depth inside the wall layer [m]
    """
    limit = max(settings.wall_distance - slack, 0.0)
    depth = limit - np.minimum(position, 1.0 - position).min(1)
    wrong = np.flatnonzero(~(depth <= WALL_TOLERANCE * (limit > 0.0)))
    if len(wrong) == 0:
        return
    first = int(wrong[0])
    outside = not np.all((position[first] >= 0.0) & (position[first] <= 1.0))
    layer = f"inside the wall layer (wall_distance={settings.wall_distance:g} m)"
    place = "outside the domain [0, 1]^3 m" if outside else layer
    hint = length_hint(position) if outside else ""
    others = f" and {len(wrong) - 1} more" if len(wrong) > 1 else ""
    where = place_outside(position[first].tolist(), limit, 1.0 - limit)
    raise UserError(
        f"{what}: particle {first}{others} at {where} m is {place}; "
        f"accepted: every coordinate from {limit:.10g} to {1.0 - limit:.10g} m{hint}"
    )


def length_hint(position: np.ndarray) -> str:
    """Units in which positions far outside of the domain would lie inside, as a question behind a message."""
    seen = position[np.isfinite(position)]
    fitting = [
        unit
        for unit, factor in (("cm", 1e-2), ("mm", 1e-3))
        if len(seen) and np.abs(seen).max() > 1.5 and seen.min() * factor >= -0.5 and seen.max() * factor <= 1.5
    ]
    return f"; positions in {' or '.join(fitting)}?" if fitting else ""
