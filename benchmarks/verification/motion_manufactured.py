"""A manufactured solution: a free bar that an acceleration of place and time keeps on a prescribed motion.

    u = A (1 - cos(omega t)) cos(k X),  k = pi / L,  with strains s = u'

    b = u_tt - E / rho s' (1 - ln(1 + s)) / (1 + s)^2,  of tau = E ln(1 + s), nu 0, P = tau / (1 + s)

The ends have no strain and no traction. The acceleration is a load of one's own over undeformed places, one a step.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

import pcnclaws as pc
from benchmarks.orders import GridError, orders_of
from benchmarks.verification.case import Case, Curve, Line, Outcome, Table, one_number
from benchmarks.verification.motion_bar import DENSITY, LENGTH, SOUND, YOUNG
from benchmarks.verification.motion_scenes import NO_GRAVITY, array, box, steps_of
from pcnclaws.laws.elasticity import StVKHencky
from pcnclaws.laws.materials import Material
from pcnclaws.tensors.tensor_types import Scalars, SceneIndex, Vectors

SOURCE = "manufactured solution"
HENCKY = Material("hencky", StVKHencky, None, {"youngs_modulus": (10.0, 1e6), "poissons_ratio": (-0.5, 0.4)})
NUMBER = math.pi / LENGTH
# 1.3 times that of the free bar, so that the motion is not its own.
OMEGA = 1.3 * NUMBER * SOUND
DURATION = 0.9 * 2.0 * math.pi / OMEGA
CELLS, CFL = (12, 25, 50), 0.35
SMALL, LARGE = 2e-3, 5e-2
ERROR = "RMS error / largest displacement"
EVERYWHERE = (-1e9, -1e9, -1e9), (1e9, 1e9, 1e9)


@dataclass(frozen=True, eq=False)
class Forcing(pc.Load):
    """A load along x of a profile [m/s^2] over undeformed places [m]."""

    profile: Callable[[Tensor], Tensor] = torch.zeros_like

    def share(self, position: Vectors, mass: Scalars, scene_index: SceneIndex) -> Scalars:
        return self.profile(position[0])


class Forced(NamedTuple):
    """A run.

    cells      of the grid along the bar
    steps      until DURATION
    strain     largest one of the motion [-]
    particles  along the edge of a cell
    staggered  start with the velocities of half a step before, as symplectic Euler has them, not those of the start
    """

    cells: int
    steps: int
    strain: float = SMALL
    particles: int = 2
    staggered: bool = True

    @property
    def spacing(self) -> float:
        """dx [m]."""
        return LENGTH / self.cells

    @property
    def amplitude(self) -> float:
        """A [m]."""
        return 0.5 * self.strain / NUMBER

    def displacement(self, along: np.ndarray, time: float) -> np.ndarray:
        """u [m] of places [m]."""
        return self.amplitude * (1.0 - math.cos(OMEGA * time)) * np.cos(NUMBER * along)

    def forcing(self, time: float, time_step: float) -> Forcing:
        """The acceleration of the step that begins at a time [s]."""

        def profile(place: Tensor) -> Tensor:
            shape, turned = (NUMBER * place).cos(), math.cos(OMEGA * time)
            strain = -NUMBER * self.amplitude * (1.0 - turned) * (NUMBER * place).sin()
            slope = -(NUMBER**2) * self.amplitude * (1.0 - turned) * shape
            inertia = self.amplitude * OMEGA**2 * turned * shape
            return inertia - SOUND**2 * slope * (1.0 - strain.log1p()) / (1.0 + strain) ** 2

        return Forcing(*EVERYWHERE, acceleration=(1.0, 0.0, 0.0), start=time, end=time + time_step, profile=profile)


@cache
def displacements(run: Forced) -> Line:
    """Displacements of the particles in the end [m] over their undeformed places [m], beside the prescribed ones."""
    dx, time_step = run.spacing, DURATION / run.steps
    body = box(
        (0.0, 0.0, 0.0), (LENGTH, 2.0 * dx, 2.0 * dx), (run.particles * run.cells, 2 * run.particles, 2 * run.particles)
    )
    along = array(body.position)[:, 0]
    velocity = np.zeros((len(along), 3))
    begun = -math.sin(0.5 * OMEGA * time_step) if run.staggered else 0.0
    velocity[:, 0] = begun * run.amplitude * OMEGA * np.cos(NUMBER * along)
    settings = pc.Settings(time_step=time_step, domain=None, grid_spacing=dx, gravity=NO_GRAVITY, density=DENSITY)
    loads = [run.forcing(step * time_step, time_step) for step in range(run.steps)]
    moduli: dict[str, Any] = {"youngs_modulus": YOUNG, "poissons_ratio": 0.0}
    scene = pc.Scene(body, pc.analytic_law(HENCKY), velocity=velocity, settings=settings, loads=loads, **moduli)
    motion = scene.simulate(run.steps, run.steps, dtype=torch.float64)
    return Line(
        f"{run.cells} cells", along, array(motion.position)[-1, :, 0] - along, run.displacement(along, DURATION)
    )


def final_error(run: Forced) -> float:
    """The RMS error of the displacements in the end over the largest one [-]."""
    line = displacements(run)
    return _rms(line.ours, line.theirs) / (2.0 * run.amplitude)


def order(strain: float) -> Outcome:
    """From the two finest of three grids, the time step proportional to the grid spacing."""
    runs = [_proportional(cells, strain) for cells in CELLS]
    errors = [GridError(run.spacing, final_error(run)) for run in runs]
    orders = orders_of(errors)
    rows = [
        [str(run.cells), str(run.steps), f"{error.error:.2e}", "" if p is None else f"{p:.2f}"]
        for run, error, p in zip(runs, errors, [None, *orders], strict=True)
    ]
    first = slice(None, None, 16)  # of the particles of a cross-section
    shown = displacements(runs[1])
    line = Line(shown.label, *(np.asarray(values)[first] for values in (shown.x, shown.ours, shown.theirs)))
    curve = Curve("place [m]", "displacement [m]", [line])
    return one_number(orders[-1] or 0.0, 2.0, curve=curve, table=Table(["cells", "steps", ERROR, "order"], rows))


def order_of_fine_grids() -> Outcome:
    """Between 50 and 100 cells with two particles along an edge of a cell; a table with three and four."""
    rows, orders = [], []
    for particles in (2, 3, 4):
        runs = [_proportional(cells, SMALL, particles) for cells in (50, 100)]
        errors = [final_error(run) for run in runs]
        orders.append(math.log2(errors[0] / errors[1]))
        rows.append([str(particles), *(f"{error:.2e}" for error in errors), f"{orders[-1]:.2f}"])
    table = Table(["particles along an edge", f"{ERROR}, 50 cells", "100 cells", "order"], rows)
    return one_number(orders[0], 2.0, table=table)


def _proportional(cells: int, strain: float, particles: int = 2) -> Forced:
    """The run whose time step is proportional to the grid spacing."""
    return Forced(cells, steps_of(DURATION, CFL * LENGTH / cells / SOUND)[0], strain, particles)


def order_in_time() -> Outcome:
    """On 25 cells, from the changes between three of the time steps 1, 1/2, 1/4, 1/8; a table with all."""
    most = steps_of(DURATION, 0.7 * LENGTH / 25 / SOUND)[0]
    runs = [Forced(25, most * 2**k, staggered=False) for k in range(4)]
    found = [displacements(run).ours for run in runs]
    apart = [_rms(a, b) / (2.0 * runs[0].amplitude) for a, b in pairwise(found)]
    orders = [math.log2(a / b) for a, b in pairwise(apart)]
    told = zip(["", *(f"{one:.2e}" for one in apart)], ["", "", *(f"{one:.2f}" for one in orders)], strict=True)
    rows = [[str(run.steps), f"{final_error(run):.2e}", *cells] for run, cells in zip(runs, told, strict=True)]
    return one_number(orders[0], 1.0, table=Table(["steps", ERROR, "change", "order"], rows))


def _rms(ours: Sequence[float] | np.ndarray, theirs: Sequence[float] | np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(np.asarray(ours) - np.asarray(theirs)))))


CASES = [
    Case(
        "manufactured_order",
        "motion",
        "A bar that a load of place and time keeps on a prescribed motion with strains of 0.2 % has errors of second "
        "order in the grid spacing, the time step proportional to it.",
        SOURCE,
        0.15,
        lambda: order(SMALL),
        slow=True,
    ),
    Case(
        "manufactured_order_large",
        "motion",
        "The same with strains of 5 %, where particles move by up to 1.6 cells.",
        SOURCE,
        0.15,
        lambda: order(LARGE),
        slow=True,
    ),
    Case(
        "manufactured_order_fine",
        "motion",
        "The error for strains of 0.2 % goes on falling with second order from 50 to 100 cells.",
        SOURCE,
        0.15,
        order_of_fine_grids,
        slow=True,
        why="A part of the error is that of the integral over particles, which depends on their number in a cell and "
        "not on the grid: some 1e-4 here, with either sign. Below it the order is not 2, and where both errors meet, "
        "as here with two particles along an edge, it seems better than it is.",
    ),
    Case(
        "manufactured_order_in_time",
        "motion",
        "On 25 cells the motion with strains of 0.2 % changes by the first order in the time step.",
        SOURCE,
        0.15,
        order_in_time,
        slow=True,
    ),
]
