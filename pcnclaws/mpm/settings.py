"""The numerical settings of a simulation: validated numbers, one owner."""

import math
from dataclasses import dataclass
from typing import TypeAlias

from torch import Tensor

from pcnclaws.errors import UserError, unknown_name
from pcnclaws.mpm.colliders import Collider
from pcnclaws.mpm.contact import CONTACTS, VERSION_1_STICK, require_friction
from pcnclaws.mpm.loads import Load
from pcnclaws.mpm.transfer_orders import APIC, TRANSFERS, require_transfer

Corner: TypeAlias = tuple[float, float, float]
Domain: TypeAlias = tuple[Corner, Corner]

UNIT_BOX: Domain = ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
FEWEST_CELLS, MOST_CELLS = 4, 10**6  # along an edge of the domain
# 3 * 0.05 <= 0.15 is False in floating point: distances are compared with this tolerance in units of dx.
DISTANCE_TOLERANCE = 1e-6
# A start so near to a whole number of steps is one.
WHOLE_STEP = 1e-5
# Accepted rounding of a number of cells.
CELL_TOLERANCE = 1e-3


@dataclass(frozen=True)
class SimulationSettings:
    """Settings of the grid and of the time step, and what stands around the bodies. y is up.

    time_step      [s]
    grid_spacing   dx [m]; the domain is a whole number of cells along each axis
    wall_distance  thickness of the wall layer [m]: every grid node at most this far from a side is a wall node
    gravity        [m/s^2]
    boundary       contact of the walls: 'separate', 'slip' or 'sticky', see mpm/contact.py
    density        [kg/m^3]
    domain         lower and upper corner of the box of the domain [m], None without bounds and walls
    friction       Coulomb's coefficient of friction of the walls [-]
    colliders      obstacles, which act on the grid in this order, after the walls
    loads          forces and accelerations on parts of the bodies
    start_time     time of the first step [s] by which colliders move and loads act
    transfer       between particles and grid: one of TRANSFERS, see mpm/transfer.py
    """

    time_step: float = 5e-4
    grid_spacing: float = 0.05
    wall_distance: float = 0.1
    gravity: Corner = (0.0, -9.8, 0.0)
    boundary: str = "separate"
    density: float = 1000.0
    domain: Domain | None = UNIT_BOX
    friction: float = 0.0
    colliders: tuple[Collider, ...] = ()
    loads: tuple[Load, ...] = ()
    start_time: float = 0.0
    transfer: str = APIC

    def __post_init__(self) -> None:
        _require_positive("simulation.time_step", self.time_step)
        _require_positive("simulation.density", self.density)
        _require_positive("simulation.grid_spacing", self.grid_spacing)
        if len(self.gravity) != 3 or not all(math.isfinite(g) for g in self.gravity):
            raise UserError(f"simulation.gravity={list(self.gravity)} is wrong; accepted: three finite numbers [m/s^2]")
        if self.boundary not in (*CONTACTS, VERSION_1_STICK):
            raise unknown_name("simulation.boundary", self.boundary, CONTACTS)
        require_friction("simulation.friction", self.friction, "simulation.boundary", self.boundary)
        start = self.start_time
        if isinstance(start, bool) or not isinstance(start, (int, float)) or not math.isfinite(start):
            raise UserError(f"scene.start_time={start} is not accepted; accepted: a finite number [s]")
        require_transfer("simulation.transfer", self.transfer)
        if self.domain is not None:
            self._check_domain(self.domain)

    def _check_domain(self, domain: Domain) -> None:
        _require_box("simulation.domain", domain)
        edges = [high - low for low, high in zip(*domain, strict=True)]
        cells = [edge / self.grid_spacing for edge in edges]
        if not all(math.isfinite(count) and abs(count - round(count)) <= CELL_TOLERANCE for count in cells):
            raise UserError(
                f"simulation.grid_spacing={self.grid_spacing:g} does not fit the domain of "
                f"{' x '.join(f'{edge:g}' for edge in edges)} m; accepted: a whole number of cells along each axis"
            )
        if not all(FEWEST_CELLS <= round(count) <= MOST_CELLS for count in cells):
            raise UserError(
                f"simulation.grid_spacing={self.grid_spacing:g} is out of range; "
                f"accepted: from {FEWEST_CELLS} to {MOST_CELLS} cells along each axis of the domain"
            )
        # the spacing that the cells have, to the last digit
        object.__setattr__(self, "grid_spacing", edges[0] / round(cells[0]))
        if not 0.0 <= self.wall_distance < 0.5 * min(edges):
            raise UserError(
                f"simulation.wall_distance={self.wall_distance} is out of range; "
                f"accepted: 0 to below {0.5 * min(edges):g} m"
            )

    @property
    def cells(self) -> tuple[int, int, int] | None:
        """Number of cells along each axis of the domain, None without bounds."""
        if self.domain is None:
            return None
        x, y, z = (round((high - low) / self.grid_spacing) for low, high in zip(*self.domain, strict=True))
        return x, y, z

    @property
    def limits(self) -> Domain:
        """Lower and upper corner between which particles may be [m], those of the largest numbers without bounds."""
        if self.domain is not None:
            return self.domain
        far = 1e30
        return (-far, -far, -far), (far, far, far)

    def tensors(self) -> list[Tensor]:
        """The numbers of colliders and loads that are tensors, which may carry derivatives."""
        return [value for owner in (*self.colliders, *self.loads) for value in owner.tensors()]

    @property
    def transfer_order(self) -> int:
        """Order of the affine XPIC of the transfer, 1 for APIC."""
        return TRANSFERS[self.transfer]

    @property
    def changes(self) -> bool:
        """Whether what stands around the bodies changes with time: colliders that move, loads."""
        return bool(self.loads) or any(collider.moves for collider in self.colliders)

    def time_at(self, step: int) -> float:
        """Time at which colliders and loads are in a step [s], counted from the start.

        A start after a whole number of steps is counted in steps: the times are those of a run from the beginning, to
        the last bit.
        """
        first = self.start_time / self.time_step
        if abs(first - round(first)) < WHOLE_STEP:
            return (round(first) + step) * self.time_step
        return self.start_time + step * self.time_step

    def within(self, distance: float) -> Domain:
        """Lower and upper corner of what is at least so far from the sides of the domain [m]; infinite without."""
        low, high = self.domain or ((-math.inf,) * 3, (math.inf,) * 3)
        return (
            (low[0] + distance, low[1] + distance, low[2] + distance),
            (high[0] - distance, high[1] - distance, high[2] - distance),
        )

    @property
    def volume(self) -> float:
        """Of the domain [m^3]."""
        if self.domain is None:
            return math.inf
        return math.prod(high - low for low, high in zip(*self.domain, strict=True))

    @property
    def floor(self) -> float:
        """Height of the inner face of the lowest wall [m], 0 without walls."""
        return 0.0 if self.domain is None else self.domain[0][1] + self.wall_distance

    @property
    def walls_hold(self) -> bool:
        """Whether no particle leaves the domain, however hard it is pressed against a wall.

        Half a cell behind the last wall node all nodes of a particle's stencil are wall nodes, and nothing moves it on:
        that place must lie in the domain, so that the layer must hold the node at dx.
        """
        return self.domain is None or self.wall_distance >= (1.0 - DISTANCE_TOLERANCE) * self.grid_spacing

    def require_walls_that_hold(self) -> None:
        """Refuses a wall layer that particles can be pressed through with a UserError."""
        if not self.walls_hold and self.domain is not None:
            shortest = min(high - low for low, high in zip(*self.domain, strict=True))
            raise UserError(
                f"simulation.wall_distance={self.wall_distance:g} is too thin to hold what is pressed against it; "
                f"accepted: {_rounded_up(self.grid_spacing)}, which is simulation.grid_spacing, "
                f"to below {0.5 * shortest:g} m"
            )


def _rounded_up(value: float) -> str:
    """The number in six digits, not below it."""
    digits = f"{value:.6g}"
    return digits if float(digits) >= value else f"{value + 10.0 ** (math.floor(math.log10(value)) - 5):.6g}"


def _require_box(option: str, box: Domain) -> None:
    corners = [list(corner) for corner in box]
    numbers = [x for corner in corners for x in corner]
    if [len(corner) for corner in corners] != [3, 3] or not all(math.isfinite(x) for x in numbers):
        raise UserError(f"{option}={corners} is not accepted; accepted: two corners of three finite numbers each [m]")
    if not all(low < high for low, high in zip(*corners, strict=True)):
        raise UserError(f"{option}={corners} is empty; accepted: a lower and an upper corner [m]")


def _require_positive(option: str, value: float) -> None:
    if not (math.isfinite(value) and value > 0.0):
        raise UserError(f"{option}={value} is out of range; accepted: a positive finite number")
