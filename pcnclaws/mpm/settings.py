"""The numerical settings of a simulation: validated numbers, one owner."""

import math
from dataclasses import dataclass

from pcnclaws.errors import UserError, unknown_name

BOUNDARIES = ("slip", "stick")
# The whole grid is stored, some 30 bytes a node with its masks: 256 nodes an edge are half a gigabyte a scene.
MAXIMUM_GRID_NODES = 256
# 3 * 0.05 <= 0.15 is False in floating point: distances are compared with this tolerance in units of dx.
DISTANCE_TOLERANCE = 1e-6


@dataclass(frozen=True)
class SimulationSettings:
    """Settings of the grid and of the time step. The domain is the unit box [0, 1]^3 m, y is up.

    time_step      [s]
    grid_nodes     cells along an edge of the domain; grid node i lies at i / grid_nodes
    wall_distance  thickness of the wall layer [m]: every grid node at most this far from a side is a wall node
    gravity        [m/s^2]
    boundary       'slip' removes the velocity component that points into a wall, 'stick' the whole velocity then
    density        [kg/m^3]
    """

    time_step: float = 5e-4
    grid_nodes: int = 20
    wall_distance: float = 0.1
    gravity: tuple[float, float, float] = (0.0, -9.8, 0.0)
    boundary: str = "slip"
    density: float = 1000.0

    def __post_init__(self) -> None:
        _require_positive("simulation.time_step", self.time_step)
        _require_positive("simulation.density", self.density)
        if isinstance(self.grid_nodes, bool) or not 4 <= self.grid_nodes <= MAXIMUM_GRID_NODES:
            raise UserError(
                f"simulation.grid_nodes={self.grid_nodes} is out of range; "
                f"accepted: a whole number from 4 to {MAXIMUM_GRID_NODES}"
            )
        if not 0.0 <= self.wall_distance < 0.5:
            raise UserError(
                f"simulation.wall_distance={self.wall_distance} is out of range; accepted: 0 to below 0.5 m"
            )
        if len(self.gravity) != 3 or not all(math.isfinite(g) for g in self.gravity):
            raise UserError(f"simulation.gravity={list(self.gravity)} is wrong; accepted: three finite numbers [m/s^2]")
        if self.boundary not in BOUNDARIES:
            raise unknown_name("simulation.boundary", self.boundary, BOUNDARIES)

    @property
    def grid_spacing(self) -> float:
        """dx [m]."""
        return 1.0 / self.grid_nodes

    @property
    def walls_hold(self) -> bool:
        """Whether no particle leaves the domain, however hard it is pressed against a wall.

        Half a cell behind the last wall node all nodes of a particle's stencil are wall nodes, and nothing moves it on:
        that place must lie in the domain, so that the layer must hold the node at dx.
        """
        return self.wall_distance >= (1.0 - DISTANCE_TOLERANCE) * self.grid_spacing

    def require_walls_that_hold(self) -> None:
        """Refuses a wall layer that particles can be pressed through with a UserError."""
        if not self.walls_hold:
            raise UserError(
                f"simulation.wall_distance={self.wall_distance:g} is too thin to hold what is pressed against it; "
                f"accepted: {_rounded_up(self.grid_spacing)}, which is 1 / simulation.grid_nodes, to below 0.5 m"
            )


def _rounded_up(value: float) -> str:
    """The number in six digits, not below it."""
    digits = f"{value:.6g}"
    return digits if float(digits) >= value else f"{value + 10.0 ** (math.floor(math.log10(value)) - 5):.6g}"


def _require_positive(option: str, value: float) -> None:
    if not (math.isfinite(value) and value > 0.0):
        raise UserError(f"{option}={value} is out of range; accepted: a positive finite number")
