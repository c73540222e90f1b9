"""How long may a time step be? The CFL number of a scene, and the step that it allows."""

import logging
import math
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from pcnclaws.errors import UserError
from pcnclaws.laws.parameters import compression_wave_speed
from pcnclaws.mpm.diagnostics import cfl_number, fall_speed
from pcnclaws.mpm.settings import SimulationSettings

log = logging.getLogger(__name__)

COMFORTABLE_CFL = 0.4
# Measured on falling and spinning cubes of all materials at the ends of their training ranges, 20 and 32 nodes: all are
# stable at 0.7; with nu of 0.4 most have diverged at 1.0; with nu of 0.1 many survive 1.6.
STABLE_CFL = 1.0


def largest_speed(
    position: Float[np.ndarray, "particles 3"],
    velocity: Float[np.ndarray, "particles 3"],
    gravity: tuple[float, float, float],
    wall_distance: float,
) -> float:
    """A bound of the speed before contact [m/s]: the fastest particle after the longest fall.

    position  [m], (particles, 3)
    velocity  [m/s], (particles, 3)
    """
    start = float(np.linalg.norm(velocity, axis=1).max())
    strength = math.hypot(*gravity)
    if strength == 0.0:
        return start
    # a body falls until its foremost particle meets the first wall in the direction of gravity
    to_wall = np.where(np.asarray(gravity) < 0.0, position - wall_distance, 1.0 - wall_distance - position)
    along = [to_wall[:, axis].min() * strength / abs(g) for axis, g in enumerate(gravity) if g != 0.0]
    return fall_speed(start, max(float(min(along)), 0.0), strength)


def scene_cfl(settings: SimulationSettings, parameters: Mapping[str, float], speed: float) -> float:
    """CFL number dt (c + |v|) / dx [-] of a material that moves with at most `speed` [m/s]."""
    return cfl_number(settings.time_step, settings.grid_spacing, _wave_speed(settings, parameters), speed)


def automatic_time_step(settings: SimulationSettings, parameters: Mapping[str, float], speed: float) -> float:
    """The time step [s] of CFL number 0.4, rounded down to three digits."""
    step = settings.time_step * COMFORTABLE_CFL / scene_cfl(settings, parameters, speed)
    unit = 10.0 ** (math.floor(math.log10(step)) - 2)
    return float(f"{math.floor(step / unit) * unit:.3g}")


def check_time_step(settings: SimulationSettings, parameters: Mapping[str, float], speed: float) -> None:
    """Refuses a time step above the stability boundary with a UserError, warns in one line above CFL number 0.4."""
    cfl = scene_cfl(settings, parameters, speed)
    if cfl > STABLE_CFL:
        raise UserError(
            f"simulation.time_step={settings.time_step:g} is unstable; accepted: "
            f"{time_step_limit(settings, parameters, speed)}"
        )
    if cfl > COMFORTABLE_CFL:
        log.warning(
            "simulation.time_step=%g has the CFL number %.2f, above %g: expect errors of the time step; "
            "simulation.time_step=auto chooses %g s",
            settings.time_step,
            cfl,
            COMFORTABLE_CFL,
            automatic_time_step(settings, parameters, speed),
        )


def time_step_limit(settings: SimulationSettings, parameters: Mapping[str, float], speed: float) -> str:
    """In words: the largest time step of this material, and the stiffest material of this time step."""
    wave = _wave_speed(settings, parameters)
    largest = STABLE_CFL * settings.grid_spacing / (wave + speed)
    # E grows with the square of the wave speed
    room = STABLE_CFL * settings.grid_spacing / settings.time_step - speed
    stiffest = parameters["youngs_modulus"] * (max(room, 0.0) / wave) ** 2
    accepted = f"at most {largest:.3g} s for youngs_modulus={parameters['youngs_modulus']:g} at {speed:.3g} m/s"
    return accepted if room <= 0.0 else f"{accepted}, or youngs_modulus at most {stiffest:.3g} Pa for this step"


def _wave_speed(settings: SimulationSettings, parameters: Mapping[str, float]) -> float:
    return compression_wave_speed(parameters["youngs_modulus"], parameters["poissons_ratio"], settings.density)
