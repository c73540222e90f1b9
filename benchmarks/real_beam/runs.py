"""The simulations of the page: each a row that is kept, tips as plain numbers."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from benchmarks.real_beam.law import strengths
from benchmarks.real_beam.scene import LENGTH, Beam, Tip, swing

# Of the studies of grid and Poisson's ratio [Pa].
YOUNG = 2.9e5
POISSON = 0.45
# Over the width, of the runs that are fitted: what finer ones change is in the study of convergence.
CELLS = 3
RATIO_CELLS = 4
DURATION, INTERVAL = 2.4, 0.0025
# Of the runs that measure sag and frequency alone [s], by weight [kg].
SHORT = {0.0: 0.3, 0.052: 0.52}
FIRST_GUESS = {0.0: 7.6, 0.052: 4.4, 0.101: 3.3}
DIGITS = 8

Plan = dict[str, Callable[[], Any]]


def plan(cells: Sequence[int], ratios: Sequence[float]) -> Plan:
    """Names and makers of the rows of the studies.

    cells   over the width, of the study of convergence
    ratios  of Poisson
    """
    rows: Plan = {}
    for weight in SHORT:
        rows |= {
            f"{count} cells, {1e3 * weight:g} g": partial(short, Beam(count, YOUNG, POISSON, weight=weight))
            for count in cells
        }
    rows |= {f"nu {ratio:g}": partial(short, Beam(RATIO_CELLS, YOUNG, ratio)) for ratio in ratios}
    return rows


def tips(wanted: Mapping[str, tuple[float, tuple[float, float, float]]]) -> dict[str, dict[str, Any]]:
    """The motions of some beams on one grid, as plain numbers, by name.

    wanted  weight [kg], and the law: long-term E [Pa], strength and exponent [-]
    """
    beams = [
        Beam(CELLS, modulus, POISSON, tuple(strengths(strength, exponent).tolist()), weight)
        for weight, (modulus, strength, exponent) in wanted.values()
    ]
    found = swing(beams, DURATION, INTERVAL)
    return {
        name: plain(tip)
        | {"youngs_modulus": beam.youngs_modulus, "strengths": list(beam.strengths), "weight": beam.weight}
        for name, tip, beam in zip(wanted, found, beams, strict=True)
    }


def plain(tip: Tip) -> dict[str, Any]:
    """A tip as lists."""
    return {name: np.round(getattr(tip, name), DIGITS).tolist() for name in ("time", "middle", "gradient")}


def tip_of(row: Mapping[str, Any]) -> Tip:
    """The inverse of `plain`."""
    return Tip(*(np.asarray(row[name]) for name in ("time", "middle", "gradient")))


def short(beam: Beam) -> dict[str, float]:
    """Sag [m], slope [rad], frequency [Hz] and share of critical damping [-] of a beam without Maxwell elements."""
    tip = swing([beam], SHORT[beam.weight])[0]
    sag, frequency, damping = ringing(tip.time, tip.height, FIRST_GUESS[beam.weight])
    slope = ringing(tip.time, np.arcsin(tip.gradient[:, 0, 2]), frequency)[0]
    return {"sag": sag, "slope": slope, "frequency": frequency, "damping": damping, "time_step": beam.scene().time_step}


def ringing(time: np.ndarray, signal: np.ndarray, frequency: float) -> tuple[float, float, float]:
    """Where a damped oscillation rests below 0, its frequency [Hz], and its share of the critical damping [-].

    frequency  first guess [Hz]
    """

    def shares(decay: float, f: float) -> tuple[np.ndarray, np.ndarray]:
        envelope, angle = np.exp(-decay * time), 2.0 * np.pi * f * time
        basis = np.stack((np.ones_like(time), envelope * np.cos(angle), envelope * np.sin(angle)), axis=1)
        found = np.linalg.lstsq(basis, signal, rcond=None)[0]
        return found, basis @ found - signal

    # the rest and both amplitudes are linear: decay and frequency alone are sought
    decay, f = least_squares(lambda x: 1e3 * shares(*x)[1], (1.0, frequency), x_scale=(1.0, 0.1)).x.tolist()
    return -float(shares(decay, f)[0][0]), f, decay / (2.0 * np.pi * f)


def timoshenko(beam: Beam) -> dict[str, float]:
    """Sag [m] and frequency [Hz] of the bare beam after Euler and Bernoulli, and the sag with shear."""
    weight = 1070.0 * 9.81 * 0.03**2
    bending = beam.youngs_modulus * 0.03**4 / 12.0
    shear = beam.youngs_modulus / (2.0 + 2.0 * beam.poissons_ratio) * 0.03**2 * 5.0 / 6.0
    sag = weight * LENGTH**4 / (8.0 * bending)
    frequency = 1.8751040687**2 / (2.0 * np.pi * LENGTH**2) * np.sqrt(bending / (1070.0 * 0.03**2))
    return {"sag": sag, "frequency": float(frequency), "sag_with_shear": sag + weight * LENGTH**2 / (2.0 * shear)}
