"""From the survival map to the largest stable CFL numbers."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

Row = Mapping[str, Any]
STABLE = "s"
CRUSHED_BELOW = 0.7


def single_particle_limit(poissons_ratio: float) -> float:
    """The CFL number up to which a particle alone on the grid swings stably, with the speed of sound for its speed.

    The affine velocity of a lone particle obeys C' = -4 tau / (rho dx^2) exactly, F' = C: a change of volume swings
    with omega^2 = 12 K / (rho dx^2), a shear with 8 mu / (rho dx^2), and symplectic Euler is stable up to omega dt = 2.
    With c^2 = (lambda + 2 mu) / rho that is the smaller of sqrt((1 - nu) / (1 + nu)) and sqrt((1 - nu) / (1 - 2 nu)).
    """
    nu = poissons_ratio
    return math.sqrt(min((1.0 - nu) / (1.0 + nu), (1.0 - nu) / (1.0 - 2.0 * nu)))


def limits_of(
    rows: Sequence[Row], moduli: Sequence[float], ratios: Sequence[float]
) -> dict[str, dict[str, list[float]]]:
    """Largest CFL number by material and Poisson's ratio up to which the bodies of all stiffnesses are stable.

    {material: {"poissons_ratio": [...], "cfl": [...]}}; stiffnesses whose bodies are crushed do not count.
    rows  the batches of the map, with their "fates" by number of the modulus and of the ratio
    """
    found = {}
    for material in dict.fromkeys(row["material"] for row in rows):
        same = [row for row in rows if row["material"] == material]
        limits: dict[float, float] = {}
        for k, ratio in enumerate(ratios):
            by_modulus = [limit_of(same, modulus, k) for modulus in range(len(moduli))]
            counted = [limit for number, limit in enumerate(by_modulus) if not is_crushed(number, by_modulus, moduli)]
            if counted:
                limits[ratio] = min(counted)
        found[material] = {"poissons_ratio": sorted(limits), "cfl": [limits[ratio] for ratio in sorted(limits)]}
    return found


def limit_of(rows: Sequence[Row], modulus: int, ratio: int) -> float:
    """Largest CFL number at which, and below which, all bodies of an E and nu, by their numbers, are stable; else 0."""
    limit = 0.0
    for level in sorted({row["cfl"] for row in rows}):
        if any(row["fates"][modulus][ratio] != STABLE for row in rows if row["cfl"] == level):
            break
        limit = level
    return limit


def is_crushed(number: int, limits: Sequence[float], moduli: Sequence[float]) -> bool:
    """Whether bodies of one of the moduli fail for another reason than their time step.

    The limit hardly depends on the stiffness when time is measured in CFL numbers. Bodies that fail at 0.7 of the
    number which stiffer ones of their Poisson's ratio survive, or sooner, are so soft that their weight and speed
    crush them.
    limits  those of all moduli
    """
    stiffer = [limit for limit, modulus in zip(limits, moduli, strict=True) if modulus > moduli[number]]
    return limits[number] <= CRUSHED_BELOW * max(stiffer, default=0.0)
