"""From the survival map to the largest stable CFL numbers."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

STABLE = "s"


def single_particle_limit(poissons_ratio: float) -> float:
    """The CFL number up to which a particle alone on the grid swings stably, with the speed of sound for its speed.

    The affine velocity of a lone particle obeys C' = -4 tau / (rho dx^2) exactly, F' = C: a change of volume swings
    with omega^2 = 12 K / (rho dx^2), a shear with 8 mu / (rho dx^2), and symplectic Euler is stable up to omega dt = 2.
    With c^2 = (lambda + 2 mu) / rho that is the smaller of sqrt((1 - nu) / (1 + nu)) and sqrt((1 - nu) / (1 - 2 nu)).
    """
    nu = poissons_ratio
    return math.sqrt(min((1.0 - nu) / (1.0 + nu), (1.0 - nu) / (1.0 - 2.0 * nu)))


def limits_of(results: Mapping[str, Any]) -> dict[str, dict[str, list[float]]]:
    """Largest CFL number by material and Poisson's ratio at which, and below which, all bodies are stable.

    {material: {"poissons_ratio": [...], "cfl": [...]}}. A stiffness counts when its bodies survive the smallest step:
    what a body's own weight or speed crushes at any step is not the time step's doing.
    """
    found = {}
    for material in dict.fromkeys(row["material"] for row in results["rows"]):
        rows = [row for row in results["rows"] if row["material"] == material]
        ratios = results["poissons_ratio"]
        limits = {ratio: _limit(rows, len(results["youngs_modulus"]), k) for k, ratio in enumerate(ratios)}
        known = {ratio: limit for ratio, limit in sorted(limits.items()) if limit is not None}
        found[material] = {"poissons_ratio": list(known), "cfl": list(known.values())}
    return found


def crushed(rows: Sequence[Mapping[str, Any]], modulus: int, ratio: int) -> bool:
    """Whether some body of this E and nu, by their numbers, fails at the smallest time step, too."""
    smallest = min(row["cfl"] for row in rows)
    return any(row["fates"][modulus][ratio] != STABLE for row in rows if row["cfl"] == smallest)


def _limit(rows: Sequence[Mapping[str, Any]], moduli: int, ratio: int) -> float | None:
    counted = [modulus for modulus in range(moduli) if not crushed(rows, modulus, ratio)]
    limit = None
    for level in sorted({row["cfl"] for row in rows}):
        same = [row["fates"][modulus][ratio] for row in rows if row["cfl"] == level for modulus in counted]
        if not same or any(fate != STABLE for fate in same):
            break
        limit = level
    return limit
