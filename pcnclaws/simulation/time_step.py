"""How long may a time step be? The CFL number of a scene, and the step that it allows."""

import json
import logging
import math
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import numpy as np
from jaxtyping import Float

from pcnclaws.errors import ParticleEscaped, SimulationDiverged, UserError
from pcnclaws.laws.parameters import compression_wave_speed
from pcnclaws.mpm.diagnostics import cfl_number, fall_speed
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.simulation.collider_distance import collider_speed, fall_to_colliders

log = logging.getLogger(__name__)

COMFORTABLE_CFL = 0.4
# Largest CFL numbers at which falling and spinning bodies stay finite and gain no energy, by material and Poisson's
# ratio. Measured by: python -m benchmarks problem=stability problem.limits=pcnclaws/simulation/stable_cfl.json
STABLE_CFL_FILE = Path(__file__).with_name("stable_cfl.json")


def largest_speed(
    position: Float[np.ndarray, "particles 3"],
    velocity: Float[np.ndarray, "particles 3"],
    settings: SimulationSettings,
) -> float:
    """A bound of the speed before contact [m/s]: the fastest particle after the longest fall, or that of a collider.

    position  [m], (particles, 3)
    velocity  [m/s], (particles, 3)
    """
    start, gravity = float(np.linalg.norm(velocity, axis=1).max()), settings.gravity
    pushed = collider_speed(settings, position)
    strength = math.hypot(*gravity)
    if strength == 0.0:
        return max(start, pushed)
    # a body falls until its foremost particle meets the first wall in the direction of gravity, or a collider
    low, high = settings.within(settings.wall_distance)
    to_wall = np.where(np.asarray(gravity) < 0.0, position - low, high - position)
    along = [to_wall[:, axis].min() * strength / abs(g) for axis, g in enumerate(gravity) if g != 0.0]
    height = min(float(min(along)), fall_to_colliders(position, settings))
    # what falls on nothing is not met at any speed
    return max(fall_speed(start, max(height, 0.0), strength) if math.isfinite(height) else start, pushed)


def scene_cfl(settings: SimulationSettings, parameters: Mapping[str, float], speed: float) -> float:
    """CFL number dt (c + |v|) / dx [-] of a material that moves with at most `speed` [m/s]."""
    return cfl_number(settings.time_step, settings.grid_spacing, _wave_speed(settings, parameters), speed)


def automatic_time_step(settings: SimulationSettings, parameters: Mapping[str, float], speed: float) -> float:
    """The time step [s] of CFL number 0.4, rounded down to three digits."""
    return _rounded_down(settings.time_step * COMFORTABLE_CFL / scene_cfl(settings, parameters, speed))


def stable_cfl(material: str, poissons_ratio: float) -> float:
    """The CFL number [-] up to which simulations of a material are stable, from the measured table.

    Between the measured Poisson's ratios it goes linearly, beyond them it stays. A material that was not measured gets
    the smallest number of all that were.
    """
    table = _stable_cfl_table()
    known = [table[material]] if material in table else list(table.values())
    return min(float(np.interp(poissons_ratio, limits["poissons_ratio"], limits["cfl"])) for limits in known)


def check_time_step(settings: SimulationSettings, parameters: Mapping[str, float], speed: float, material: str) -> None:
    """Refuses a time step above the stability boundary with a UserError, warns in one line above CFL number 0.4."""
    cfl = scene_cfl(settings, parameters, speed)
    if cfl > stable_cfl(material, parameters["poissons_ratio"]):
        raise UserError(
            f"simulation.time_step={settings.time_step:g} is unstable; accepted: "
            f"{time_step_limit(settings, parameters, speed, material)}"
        )
    if cfl > COMFORTABLE_CFL:
        log.warning(
            "simulation.time_step=%g has the CFL number %.2f: above %.2f such bodies diverged; "
            "simulation.time_step=auto stays at %g with %g s",
            settings.time_step,
            cfl,
            stable_cfl(material, parameters["poissons_ratio"]),
            COMFORTABLE_CFL,
            automatic_time_step(settings, parameters, speed),
        )


def time_step_limit(settings: SimulationSettings, parameters: Mapping[str, float], speed: float, material: str) -> str:
    """In words: the largest time step of this scene, and the stiffest material of this time step."""
    stable = stable_cfl(material, parameters["poissons_ratio"])
    wave = _wave_speed(settings, parameters)
    largest = _rounded_down(stable * settings.grid_spacing / (wave + speed))
    # E grows with the square of the wave speed
    room = stable * settings.grid_spacing / settings.time_step - speed
    accepted = f"at most {largest:.3g} s for youngs_modulus={parameters['youngs_modulus']:g} at {speed:.3g} m/s"
    if room <= 0.0:
        return accepted
    stiffest = _rounded_down(parameters["youngs_modulus"] * (room / wave) ** 2)
    return f"{accepted}, or youngs_modulus at most {stiffest:.3g} Pa for this step"


def divergence_advice(
    error: SimulationDiverged,
    settings: SimulationSettings,
    parameters: Mapping[str, float],
    speed: float,
    material: str,
) -> str:
    """In words, what to change after a divergence: the walls that a particle was pressed through, or the time step."""
    if isinstance(error, ParticleEscaped) and not settings.walls_hold:
        return (
            f"wall_distance={settings.wall_distance:g} does not hold what is pressed against it; "
            f"from {settings.grid_spacing:.6g} m, a cell of the grid, it does"
        )
    limit = time_step_limit(settings, parameters, speed, material)
    return f"time_step={settings.time_step:g}, stable: {limit}"


def _rounded_down(value: float) -> float:
    """A positive number in three digits, not above it."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 2)
    return float(f"{math.floor(value / unit) * unit:.3g}")


@cache
def _stable_cfl_table() -> dict[str, dict[str, list[float]]]:
    """By material: Poisson's ratios, increasing, and the limit at each."""
    return json.loads(STABLE_CFL_FILE.read_text(encoding="utf-8"))["limits"]


def _wave_speed(settings: SimulationSettings, parameters: Mapping[str, float]) -> float:
    return compression_wave_speed(parameters["youngs_modulus"], parameters["poissons_ratio"], settings.density)
