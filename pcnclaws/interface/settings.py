"""The numerical settings of a scene, under the names of the options simulation.*."""

import math
from collections.abc import Sequence
from dataclasses import asdict, fields
from typing import Any

from pcnclaws.errors import UserError, unknown_name
from pcnclaws.mpm.settings import SimulationSettings

PAPER = SimulationSettings()


class Settings:
    """Settings of the grid and of the time step; the paper's unless given.

    time_step      [s], or "auto": the step of CFL number 0.4 of the scene
    grid_nodes     cells along an edge of the domain, the unit box
    wall_distance  thickness of the wall layer [m]
    gravity        [m/s^2]
    boundary       "slip" or "stick"
    density        [kg/m^3]
    raises         UserError for unknown names with the nearest known one, and for values that are not accepted
    """

    def __init__(
        self,
        *,
        time_step: float | str = PAPER.time_step,
        grid_nodes: int = PAPER.grid_nodes,
        wall_distance: float | int = PAPER.wall_distance,
        gravity: Sequence[float | int] = PAPER.gravity,
        boundary: str = PAPER.boundary,
        density: float | int = PAPER.density,
        **unknown: Any,
    ) -> None:
        for name in unknown:
            raise unknown_name("simulation", name, [field.name for field in fields(SimulationSettings)])
        self.is_automatic = time_step == "auto"
        self.simulation = SimulationSettings(
            time_step=PAPER.time_step if self.is_automatic else _number("time_step", time_step, ", or auto"),
            grid_nodes=_whole("grid_nodes", grid_nodes),
            wall_distance=_number("wall_distance", wall_distance),
            gravity=_vector("gravity", gravity),
            boundary=boundary,
            density=_number("density", density),
        )
        self.simulation.require_walls_that_hold()

    def __repr__(self) -> str:
        given = asdict(self.simulation) | ({"time_step": "auto"} if self.is_automatic else {})
        return f"Settings({', '.join(f'{name}={value!r}' for name, value in given.items())})"


def whole_number(option: str, value: Any, least: int = 1) -> int:
    """A whole number of at least `least`; UserError that names the option otherwise."""
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise UserError(f"{option}={value} is not accepted; accepted: a whole number from {least}")
    return value


def _whole(name: str, value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise UserError(f"simulation.{name}={value} is not accepted; accepted: a whole number")
    return value


def _number(name: str, value: Any, words: str = "") -> float:
    if isinstance(value, bool) or not isinstance(value, float | int) or not math.isfinite(value):
        raise UserError(f"simulation.{name}={value} is not accepted; accepted: a finite number{words}")
    return float(value)


def _vector(name: str, value: Any) -> tuple[float, float, float]:
    if not isinstance(value, Sequence) or isinstance(value, str) or len(value) != 3:
        raise UserError(f"simulation.{name}={value} is not accepted; accepted: a list of 3, each a finite number")
    x, y, z = (_number(name, component) for component in value)
    return x, y, z
