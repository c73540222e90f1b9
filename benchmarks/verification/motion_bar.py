"""A bar along its axis: frequency, amplitude, order of convergence, damping by viscosity, and a wave at its ends.

The bar of de Koster et al.: length 25 m, E 100 Pa, density 1 kg/m^3, nu 0; its speeds are 0.1 % of that of sound. It is
free at both ends, or held at the lower one by a wall.
"""

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import torch

import pcnclaws as pc
from benchmarks.orders import GridError, orders_of
from benchmarks.verification.case import Case, Curve, Line, Outcome, Table, many_numbers, one_number
from benchmarks.verification.motion_scenes import NO_GRAVITY, array, at_walls, box, period_of, steps_of
from pcnclaws.laws.elasticity import StVKHencky
from pcnclaws.laws.materials import Material
from pcnclaws.laws.viscosity import NewtonianViscosity

SOURCE = "closed form; problem of de Koster et al. 2019, arXiv 1902.01169"
LENGTH, YOUNG, DENSITY = 25.0, 100.0, 1.0
SOUND = math.sqrt(YOUNG / DENSITY)
SPEED = 1e-3 * SOUND
CFL = 0.39
CELLS = (12, 25, 50)
PERIODS = 5.0
# Share of the critical damping of the viscous bar.
DAMPING = 0.05
KELVIN_VOIGT = Material(
    "kelvin_voigt",
    StVKHencky,
    None,
    {"youngs_modulus": (10.0, 1e6), "poissons_ratio": (-0.5, 0.4), "viscosity": (0.0, 1e3)},
    viscous=NewtonianViscosity,
)


class Bar(NamedTuple):
    """A bar to simulate.

    cells      of the grid along it; two particles along the edge of a cell
    held       by a wall at its lower end
    viscosity  [Pa s]
    transfer   between particles and grid
    """

    cells: int
    held: bool = False
    viscosity: float = 0.0
    transfer: str = "apic"

    @property
    def spacing(self) -> float:
        """dx [m]."""
        return LENGTH / self.cells

    @property
    def omega(self) -> float:
        """Angular frequency of the first mode [rad/s]."""
        return math.pi / LENGTH * SOUND / (2.0 if self.held else 1.0)

    @property
    def period(self) -> float:
        """[s]."""
        return 2.0 * math.pi / self.omega

    def mode(self, along: np.ndarray) -> np.ndarray:
        """The first mode at distances from the lower end [m]: a sine from the end that is held, or a cosine."""
        return np.sin(0.5 * math.pi * along / LENGTH) if self.held else np.cos(math.pi * along / LENGTH)

    def scene(self, velocity: np.ndarray, body: pc.Body, time_step: float) -> pc.Scene:
        """The scene with axial velocities [m/s], (particles,)."""
        walls = at_walls((LENGTH, 2.0 * self.spacing, 2.0 * self.spacing), self.spacing, (0.2 * LENGTH, 0.0, 0.0))[1]
        settings = pc.Settings(
            time_step=time_step,
            domain=walls if self.held else None,
            grid_spacing=self.spacing,
            wall_distance=self.spacing if self.held else 0.1,
            gravity=NO_GRAVITY,
            boundary="slip",
            density=DENSITY,
            transfer=self.transfer,
        )
        start = np.zeros((len(velocity), 3))
        start[:, 0] = velocity
        moduli: dict[str, Any] = {"youngs_modulus": YOUNG, "poissons_ratio": 0.0, "viscosity": self.viscosity}
        return pc.Scene(body, pc.analytic_law(KELVIN_VOIGT), velocity=start, settings=settings, **moduli)

    def body(self) -> tuple[pc.Body, np.ndarray]:
        """The particles, and their distances from the lower end [m]."""
        body = box(3 * [self.spacing], (LENGTH, 2.0 * self.spacing, 2.0 * self.spacing), (2 * self.cells, 4, 4))
        return body, array(body.position)[:, 0] - self.spacing


class Vibration(NamedTuple):
    """Time [s], and the share of the first mode in the velocities relative to the start [-]."""

    bar: Bar
    time: np.ndarray
    mode: np.ndarray

    @property
    def frequency(self) -> float:
        """Angular frequency from the crossings of 0 [rad/s]."""
        return 2.0 * math.pi / period_of(self.time, self.mode)

    @property
    def amplitude(self) -> float:
        """The largest share in half a period about five periods after the start [-]."""
        about = np.abs(self.time - PERIODS * self.bar.period) < 0.25 * self.bar.period
        return float(self.mode[about].max())


@cache
def vibration(bar: Bar, cfl: float = CFL) -> Vibration:
    """The bar, started in its first mode, for five periods and a quarter."""
    body, along = bar.body()
    shape = bar.mode(along)
    steps, time_step = steps_of((PERIODS + 0.3) * bar.period, cfl * bar.spacing / SOUND)
    # symplectic Euler has velocities half a step before positions
    start = SPEED * math.cos(0.5 * bar.omega * time_step) * shape
    motion = bar.scene(start, body, time_step).simulate(steps, 1, dtype=torch.float64)
    mode = array(motion.velocity)[:, :, 0] @ shape / (SPEED * shape @ shape)
    return Vibration(bar, array(motion.time) - 0.5 * time_step, mode)


def frequency() -> Outcome:
    """Of the free bar on 25 cells, with the motion of its first mode."""
    found = vibration(Bar(25))
    line = Line("first mode", found.time, found.mode, np.cos(found.bar.omega * found.time))
    curve = Curve("time [s]", "velocity of the first mode [-]", [line])
    return one_number(found.frequency, found.bar.omega, "rad/s", curve=curve)


def amplitude() -> Outcome:
    """Of the free bar on 25 cells after five periods."""
    return one_number(vibration(Bar(25)).amplitude, 1.0, "-")


def order() -> Outcome:
    """Of the frequency of the free bar, from the two finest of three grids."""
    bars = [vibration(Bar(cells)) for cells in CELLS]
    errors = [GridError(one.bar.spacing, abs(one.frequency / one.bar.omega - 1.0)) for one in bars]
    orders = orders_of(errors)
    lines = [
        [str(one.bar.cells), f"{error.error:.1e}", "" if p is None else f"{p:.2f}", f"{one.amplitude:.4f}"]
        for one, error, p in zip(bars, errors, [None, *orders], strict=True)
    ]
    table = Table(["cells", "error of the frequency", "order", "amplitude left"], lines)
    return one_number(orders[-1] or 0.0, 2.0, table=table)


def held() -> Outcome:
    """Of the bar that a wall holds, on 25 cells; the errors of three grids."""
    bars = [vibration(Bar(cells, held=True)) for cells in CELLS]
    errors = [GridError(one.bar.spacing, abs(one.frequency / one.bar.omega - 1.0)) for one in bars]
    lines = [
        [str(one.bar.cells), f"{one.frequency:.4f}", f"{error.error:.1e}", "" if p is None else f"{p:.2f}"]
        for one, error, p in zip(bars, errors, [None, *orders_of(errors)], strict=True)
    ]
    table = Table(["cells", "frequency [rad/s]", "error", "order"], lines)
    return one_number(bars[1].frequency, bars[1].bar.omega, "rad/s", table=table)


def damping() -> Outcome:
    """Share of the critical damping of a Kelvin-Voigt bar: 4/3 eta omega / (2 E), nu 0."""
    omega = Bar(25).omega
    found = vibration(Bar(25, viscosity=1.5 * DAMPING * YOUNG / omega))
    turning = omega * math.sqrt(1.0 - DAMPING**2)
    expected = np.exp(-DAMPING * omega * found.time) * (
        np.cos(turning * found.time) - DAMPING * omega / turning * np.sin(turning * found.time)
    )
    ours = -math.log(found.amplitude) / (PERIODS * 2.0 * math.pi)
    curve = Curve("time [s]", "velocity of the first mode [-]", [Line("first mode", found.time, found.mode, expected)])
    return one_number(ours, DAMPING / math.sqrt(1.0 - DAMPING**2), curve=curve)


def pulse_after_reflection(cells: int) -> Line:
    """Velocities of a pulse that has split, and come back from the held end and from the free one."""
    bar = Bar(cells, held=True)
    body, along = bar.body()
    duration = 0.9 * LENGTH / SOUND
    steps, time_step = steps_of(duration, CFL * bar.spacing / SOUND)
    motion = bar.scene(_pulse(along), body, time_step).simulate(steps, steps, dtype=torch.float64)
    path = SOUND * (duration - 0.5 * time_step)
    # images: odd at the held end, even at the free one
    images = ((1.0, along), (-1.0, -along), (1.0, 2.0 * LENGTH - along))
    theirs = sum(0.5 * sign * (_pulse(where - path) + _pulse(where + path)) for sign, where in images)
    first = slice(None, None, 16)  # of the particles of a cross-section
    ours = array(motion.velocity)[-1, :, 0]
    return Line(f"{cells} cells", along[first], ours[first], np.asarray(theirs)[first])


def _pulse(x: np.ndarray) -> np.ndarray:
    return SPEED * np.exp(-0.5 * np.square((x - 0.4 * LENGTH) / (0.06 * LENGTH)))


def wave() -> Outcome:
    """The pulse on the finest of three grids, and the errors of all."""
    lines = [pulse_after_reflection(cells) for cells in (50, 100, 200)]
    errors = [many_numbers(line.ours, line.theirs).difference for line in lines]
    orders = orders_of([GridError(1.0 / 2**k, error) for k, error in enumerate(errors)])
    told = ["", *("" if p is None else f"{p:.2f}" for p in orders)]
    rows = [[line.label, f"{error:.1e}", p] for line, error, p in zip(lines, errors, told, strict=True)]
    curve = Curve("place [m]", "velocity [m/s]", lines[-1:])
    return many_numbers(
        lines[-1].ours, lines[-1].theirs, "m/s", curve=curve, table=Table(["", "largest error / peak", "order"], rows)
    )


def order_in_time() -> Outcome:
    """Of the amplitude of the free bar on 25 cells, between CFL numbers 0.8 and 0.1; a table with the frequency."""
    levels = (0.8, 0.4, 0.2, 0.1)
    found = [vibration(Bar(25), cfl) for cfl in levels]
    lost = [1.0 - one.amplitude for one in found]
    rows = [
        [f"{cfl:g}", f"{one.frequency / one.bar.omega - 1.0:+.2e}", f"{loss:.2e}"]
        for cfl, one, loss in zip(levels, found, lost, strict=True)
    ]
    ours = math.log(lost[0] / lost[-1]) / math.log(levels[0] / levels[-1])
    return one_number(ours, 1.0, table=Table(["CFL number", "error of the frequency", "amplitude lost"], rows))


EACH_STEP = (
    "A property of APIC: each step damps what is not affine within a cell, whatever its length. Many short steps damp"
    " more than few long ones, and on a given grid nothing converges as dt goes to 0; dt goes with dx, and the order "
    "is then 2 (axial_bar_order). The frequency does converge, with second order, to that of the grid."
)
CASES = [
    Case(
        "axial_bar",
        "motion",
        "A free bar on 25 cells vibrates along its axis with (pi / L) sqrt(E / rho).",
        SOURCE,
        1e-2,
        frequency,
        slow=True,
    ),
    Case(
        "axial_bar_amplitude",
        "motion",
        "After five periods the bar on 25 cells, at CFL number 0.39, has its amplitude.",
        SOURCE,
        2e-2,
        amplitude,
        slow=True,
    ),
    Case(
        "axial_bar_order",
        "motion",
        "The error of its frequency is of second order in the grid spacing, the time step proportional to it.",
        "order of quadratic B-splines",
        0.15,
        order,
        slow=True,
    ),
    Case(
        "axial_bar_order_in_time",
        "motion",
        "On a given grid the error of the amplitude is of first order in the time step.",
        "order of symplectic Euler",
        0.15,
        order_in_time,
        slow=True,
        why=EACH_STEP,
    ),
    Case(
        "held_bar",
        "motion",
        "A bar that a wall holds at one end, on 25 cells, vibrates with (pi / 2 L) sqrt(E / rho) = 0.6283 rad/s.",
        SOURCE,
        1e-2,
        held,
        slow=True,
    ),
    Case(
        "viscous_bar",
        "motion",
        "A Kelvin-Voigt bar loses the amplitude that 4/3 eta omega / (2 E) = 0.05 of the critical damping takes.",
        "closed form of the damped oscillator",
        5e-2,
        damping,
        slow=True,
    ),
    Case(
        "wave_reflection",
        "motion",
        "A pulse on 200 cells, 12 of them its half-width, runs at sqrt(E / rho), comes back inverted from a held end "
        "and upright from a free one.",
        "closed form, d'Alembert",
        5e-2,
        wave,
        slow=True,
    ),
]
