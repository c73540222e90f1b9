"""Cantilevers that are let go from straight: they swing about the sag, with the frequency of bending."""

import math
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np
import torch

import pcnclaws as pc
from benchmarks.verification.case import Case, Curve, Line, Outcome, Table, one_number
from benchmarks.verification.motion_scenes import array, box, period_of

LENGTH, DENSITY, GRAVITY = 0.1, 1070.0, 9.81
# First root of cos(x) cosh(x) = -1, and the shear factor of a square cross-section.
ROOT, SHEAR_FACTOR = 1.8751040687119611, 5.0 / 6.0


class Beam(NamedTuple):
    """A beam of square cross-section, held where its axis begins.

    width  [m]
    cells  of the grid over the width; two particles along the edge of a cell
    """

    width: float
    youngs_modulus: float
    cells: int
    poissons_ratio: float = 0.0

    @property
    def second_moment(self) -> float:
        """I [m^4]."""
        return self.width**4 / 12.0

    @property
    def sag(self) -> float:
        """Of Euler and Bernoulli, q L^4 / (8 E I) [m]."""
        weight = DENSITY * GRAVITY * self.width**2
        return weight * LENGTH**4 / (8.0 * self.youngs_modulus * self.second_moment)

    @property
    def sag_with_shear(self) -> float:
        """Of Timoshenko, with q L^2 / (2 kappa G A) [m]."""
        shear_modulus = self.youngs_modulus / (2.0 + 2.0 * self.poissons_ratio)
        return self.sag + DENSITY * GRAVITY * LENGTH**2 / (2.0 * SHEAR_FACTOR * shear_modulus)

    @property
    def frequency(self) -> float:
        """Of Euler and Bernoulli [Hz]."""
        stiffness = self.youngs_modulus * self.second_moment / (DENSITY * self.width**2)
        return ROOT**2 / (2.0 * math.pi * LENGTH**2) * math.sqrt(stiffness)


class Swing(NamedTuple):
    """Time [s], and the height of the tip above its start [m]."""

    time: np.ndarray
    tip: np.ndarray

    @property
    def period(self) -> float:
        """[s]."""
        return period_of(self.time, self.tip - 0.5 * (self.tip.min() + self.tip.max()))

    @property
    def sag(self) -> float:
        """The mean of whole periods: where the tip would rest [m]."""
        whole = int(self.time[-1] / self.period + 0.05)
        return float(-self.tip[self.time <= whole * self.period].mean())


@cache
def swing(beam: Beam) -> Swing:
    """The beam for three periods."""
    spacing = beam.width / beam.cells
    inside = 3.0 * spacing
    counts = (round(2.0 * (LENGTH + inside) / spacing), 2 * beam.cells, 2 * beam.cells)
    body = box((-inside, 0.0, 0.0), (LENGTH + inside, beam.width, beam.width), counts)
    clamp = pc.Collider.box(low=(-1.0, -1.0, -1.0), high=(0.0, 1.0, 1.0), contact="sticky")
    settings = pc.Settings(
        domain=None, grid_spacing=spacing, gravity=(0, -GRAVITY, 0), density=DENSITY, time_step="auto"
    )
    moduli: dict[str, Any] = {"youngs_modulus": beam.youngs_modulus, "poissons_ratio": beam.poissons_ratio}
    law = pc.analytic_law("neo_hookean")
    scene = pc.Scene(body, law, colliders=[clamp], settings=settings, **moduli)
    every = math.ceil(3.0 / beam.frequency / scene.time_step / 300.0)
    motion = scene.simulate(300 * every, every, dtype=torch.float32)
    along = array(body.position)[:, 0]
    height = array(motion.position)[:, along > along.max() - 1e-9, 1].mean(1)
    return Swing(array(motion.time), height - height[0])


SLENDER = {cells: Beam(0.01, 1.6e7, cells) for cells in (2, 3, 4)}
THICK = [Beam(0.03, 263824.0, cells, nu) for cells, nu in ((3, 0.0), (6, 0.0), (3, 0.45), (6, 0.45))]


def slender(what: str, unit: str) -> Outcome:
    """Sag or frequency of the slender beam on four cells over its width; a table of three grids."""
    beams = SLENDER.values()
    ours = {beam.cells: swing(beam).sag if what == "sag" else 1.0 / swing(beam).period for beam in beams}
    theirs = SLENDER[4].sag if what == "sag" else SLENDER[4].frequency
    lines = [[str(cells), f"{value:.5g}", f"{value / theirs - 1.0:+.1e}"] for cells, value in ours.items()]
    table = Table(["cells over the width", f"{what} [{unit}]", "difference"], lines)
    found = swing(SLENDER[4])
    first_mode = -theirs_tip(SLENDER[4], found.time)
    curve = Curve("time [s]", "height of the tip [m]", [Line("tip", found.time, found.tip, first_mode)])
    return one_number(ours[4], theirs, unit, curve=curve if what == "sag" else None, table=table)


def theirs_tip(beam: Beam, time: np.ndarray) -> np.ndarray:
    """The sag of a beam let go from straight, by its first three modes of bending [m]."""
    roots = (ROOT, 4.694091132974175, 7.854757438237613)
    total = np.zeros_like(time)
    for root in roots:
        ratio = (math.cosh(root) + math.cos(root)) / (math.sinh(root) + math.sin(root))
        share = 8.0 * 4.0 * ratio / root**5 * (-1.0) ** (roots.index(root))
        omega = 2.0 * math.pi * beam.frequency * (root / ROOT) ** 2
        total += beam.sag * share * (1.0 - np.cos(omega * time))
    return total


def thick() -> Outcome:
    """Sag of the thick beam beside Timoshenko's, nu 0 on six cells; a table that shows how nu 0.45 locks."""
    lines = []
    for beam in THICK:
        sag = swing(beam).sag
        off = f"{sag / beam.sag_with_shear - 1.0:+.1e}"
        lines.append(
            [
                f"{beam.poissons_ratio:g}",
                str(beam.cells),
                *(f"{1e3 * one:.2f}" for one in (sag, beam.sag_with_shear)),
                off,
            ]
        )
    table = Table(["nu", "cells over the width", "sag [mm]", "Timoshenko [mm]", "difference"], lines)
    return one_number(swing(THICK[1]).sag, THICK[1].sag_with_shear, "m", table=table)


CASES = [
    Case(
        "cantilever_sag",
        "motion",
        "A cantilever ten times as long as high sags as Euler-Bernoulli say, on four cells over its height.",
        "closed form, Euler-Bernoulli",
        5e-2,
        partial(slender, "sag", "m"),
        slow=True,
    ),
    Case(
        "cantilever_frequency",
        "motion",
        "The same cantilever swings with the frequency of Euler-Bernoulli.",
        "closed form, Euler-Bernoulli",
        5e-2,
        partial(slender, "frequency", "Hz"),
        slow=True,
    ),
    Case(
        "thick_cantilever",
        "motion",
        "A thick one, the 3 x 3 x 10 cm of Dubied et al. with nu 0, sags as Timoshenko says, on six "
        "cells over its height.",
        "closed form, Timoshenko; geometry, density and E of the measured beam of Dubied et al. 2022",
        5e-2,
        thick,
        slow=True,
    ),
]
