"""The numerical settings of a scene, under the names of the options simulation.*."""

import math
from collections.abc import Sequence
from dataclasses import asdict, fields, replace
from typing import Any, TypeAlias

from pcnclaws.errors import UserError, unknown_name
from pcnclaws.geometry.body import Body
from pcnclaws.laws.materials import Material
from pcnclaws.mpm.settings import UNIT_BOX, Domain, SimulationSettings

Vector: TypeAlias = Sequence[float | int]
PAPER = SimulationSettings()
# What stands around a body is part of a scene here.
OF_SCENES = ("colliders", "loads", "start_time")


class Settings:
    """Settings of the grid and of the time step; the paper's unless given.

    time_step      [s], or "auto": the step of CFL number 0.4 of the scene
    domain         lower and upper corner of the box [m], None: without bounds and walls
    grid_spacing   dx [m]; the domain is a whole number of cells along each axis
    grid_nodes     instead of the spacing: cells along an edge of the unit box
    wall_distance  thickness of the wall layer [m]
    gravity        [m/s^2]
    boundary       contact of the walls: "separate", "slip" or "sticky"
    friction       Coulomb's coefficient of friction of the walls [-]
    density        [kg/m^3], None: that of the material
    transfer       between particles and grid: "apic", or "axpic2" to "axpic4", which damp less
    raises         UserError for unknown names with the nearest known one, and for values that are not accepted
    """

    def __init__(
        self,
        *,
        time_step: float | str = PAPER.time_step,
        domain: Sequence[Vector] | None = UNIT_BOX,
        grid_spacing: float | int = PAPER.grid_spacing,
        grid_nodes: int | None = None,
        wall_distance: float | int = PAPER.wall_distance,
        gravity: Vector = PAPER.gravity,
        boundary: str = PAPER.boundary,
        friction: float | int = PAPER.friction,
        density: float | int | None = None,
        transfer: str = PAPER.transfer,
        **unknown: Any,
    ) -> None:
        for name in unknown:
            known = {field.name for field in fields(SimulationSettings)} - set(OF_SCENES)
            raise unknown_name("simulation", name, {*known, "grid_nodes"})
        self.is_automatic, self.has_density = time_step == "auto", density is not None
        box = _domain(domain)
        self.simulation = SimulationSettings(
            time_step=PAPER.time_step if self.is_automatic else _number("time_step", time_step, ", or auto"),
            grid_spacing=_number("grid_spacing", grid_spacing) if grid_nodes is None else _spacing(grid_nodes, box),
            wall_distance=_number("wall_distance", wall_distance),
            gravity=_vector("gravity", gravity),
            boundary=boundary,
            density=PAPER.density if density is None else _number("density", density),
            domain=box,
            friction=_number("friction", friction),
            transfer=transfer,
        )
        self.simulation.require_walls_that_hold()

    def of(self, material: Material, body: Body) -> SimulationSettings:
        """The settings of the simulation of a body of that material.

        raises  UserError for a density that settings and particles say
        """
        if not self.has_density:
            return replace(self.simulation, density=float(material.density))
        if body.cloud.density is not None:
            raise two_densities(self.simulation.density)
        return self.simulation

    def __repr__(self) -> str:
        given = asdict(self.simulation) | ({"time_step": "auto"} if self.is_automatic else {})
        given |= {} if self.has_density else {"density": None}
        return f"Settings({', '.join(f'{name}={value!r}' for name, value in given.items() if name not in OF_SCENES)})"


def two_densities(density: float) -> UserError:
    """The error for simulation.density beside particles that bring their density."""
    return UserError(
        f"simulation.density={density:g} has no effect on particles that bring their density; accepted: one of the two"
    )


def whole_number(option: str, value: Any, least: int = 1) -> int:
    """A whole number of at least `least`; UserError that names the option otherwise."""
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise UserError(f"{option}={value} is not accepted; accepted: a whole number from {least}")
    return value


def _spacing(nodes: Any, domain: Domain | None) -> float:
    """dx of a number of cells along an edge of the unit box [m]."""
    whole_number("simulation.grid_nodes", nodes, 4)
    if domain != UNIT_BOX:
        raise UserError(
            f"simulation.grid_nodes={nodes} counts cells of the unit box; accepted beside simulation.domain: "
            "simulation.grid_spacing"
        )
    return 1.0 / nodes


def _number(name: str, value: Any, words: str = "") -> float:
    if isinstance(value, bool) or not isinstance(value, float | int) or not math.isfinite(value):
        raise UserError(f"simulation.{name}={value} is not accepted; accepted: a finite number{words}")
    return float(value)


def _vector(name: str, value: Any) -> tuple[float, float, float]:
    if not isinstance(value, Sequence) or isinstance(value, str) or len(value) != 3:
        raise UserError(f"simulation.{name}={value} is not accepted; accepted: a list of 3, each a finite number")
    x, y, z = (_number(name, component) for component in value)
    return x, y, z


def _domain(value: Any) -> Domain | None:
    if value is None:
        return None
    if not isinstance(value, Sequence) or isinstance(value, str) or len(value) != 2:
        raise UserError(f"simulation.domain={value} is not accepted; accepted: a lower and an upper corner, or None")
    low, high = (_vector("domain", corner) for corner in value)
    return low, high
