"""Drucker-Prager: the cone against another program's points, triaxial compression, and the angle that laws realise."""

import math
from functools import partial
from typing import Any

import numpy as np
import torch

import pcnclaws as pc
from benchmarks.verification.case import Case, Curve, Line, Outcome, many_numbers, one_number, violation
from benchmarks.verification.element_paths import at_constant_lateral_stress, diagonal, numbers_of

MOOSE = "MOOSE, capped_drucker_prager/gold/small_deform2_outer_tip.csv (first 20 points)"
ANGLES = (20.0, 25.0, 30.0, 35.0)


def shear_invariant(stress: np.ndarray) -> np.ndarray:
    """sqrt(J2) of principal stresses, (points, 3)."""
    deviator = stress - stress.mean(1, keepdims=True)
    return np.sqrt(0.5 * np.square(deviator).sum(1))


def cone() -> Outcome:
    """The radius of our cone where MOOSE's points are, beside theirs.

    The law of sand has no cohesion: a cohesion moves the tip to the isotropic tension c cot(phi), so that stresses are
    measured from there. MOOSE's tip is smooth, sqrt(J2 + 16) in the place of sqrt(J2).
    """
    table = numbers_of("small_deform2_outer_tip_first20.csv")
    theirs = np.stack([table[f"s_{axis}{axis}"][1:] for axis in "xyz"], axis=1)
    tip = 10.0 / math.tan(math.radians(20.0))
    parameters: dict[str, Any] = {"youngs_modulus": 2e7, "poissons_ratio": 0.0, "friction_angle": 20.0}
    mean = theirs.mean(1, keepdims=True)
    # far outside of the cone, in the direction of their deviator
    trial = (mean - tip + 5.0 * (theirs - mean)) / 2e7
    law = pc.analytic_law("sand")
    elastic = law.return_map(diagonal(*np.exp(trial).T), **parameters)
    ours = law.stress(elastic, **parameters).diagonal(dim1=1, dim2=2).numpy()
    return many_numbers(shear_invariant(ours), np.sqrt(np.square(shear_invariant(theirs)) + 16.0))


def triaxial(angle: float) -> Outcome:
    """q / p at failure of cohesionless sand in triaxial compression at a cell pressure of 10 kPa."""
    parameters: dict[str, Any] = {"youngs_modulus": 4e5, "poissons_ratio": 0.25, "friction_angle": angle}
    axial = -np.linspace(0.0, 0.2, 41)[1:]
    stress = at_constant_lateral_stress(pc.analytic_law("sand"), axial, -1e4, parameters)
    ratio = (stress[:, 1] - stress[:, 0]) / -stress.mean(1)
    sine = math.sin(math.radians(angle))
    expected = 6.0 * sine / (3.0 - sine)
    curve = Curve(
        "axial Hencky strain [-]",
        "q / p [-]",
        [Line(f"{angle:g} degrees", -axial, ratio, np.full(len(axial), expected))],
    )
    return one_number(float(ratio[-1]), expected, curve=curve)


def dilation() -> Outcome:
    """Plastic change of volume over plastic shear strain where sand flows under pressure."""
    parameters: dict[str, Any] = {"youngs_modulus": 4e5, "poissons_ratio": 0.25, "friction_angle": 30.0}
    trial = torch.tensor([[-0.3, 0.05, 0.06]], dtype=torch.float64)
    elastic = pc.analytic_law("sand").return_map(diagonal(*trial.exp().T), **parameters)
    plastic = trial - elastic.diagonal(dim1=1, dim2=2).log()
    return violation(float(plastic.sum() / plastic.norm()))


CASES = [
    Case(
        "drucker_prager_cone",
        "laws",
        "The Drucker-Prager cone has the radius of MOOSE's outer cone at 20 points with any Lode angle.",
        MOOSE,
        1e-6,
        cone,
    ),
    *(
        Case(
            f"triaxial_{angle:.0f}",
            "laws",
            f"Triaxial compression of cohesionless sand of {angle:g} degrees fails at q/p = 6 sin phi / (3 - sin phi).",
            "closed form, Drucker and Prager 1952, outer fit of Mohr-Coulomb",
            1e-9,
            partial(triaxial, angle),
            slow=angle != 30.0,
        )
        for angle in ANGLES
    ),
    Case(
        "sand_no_dilation",
        "laws",
        "Sand that flows under pressure keeps its volume: the plastic change of volume is 0.",
        "Klar et al. 2016, non-associated flow",
        1e-12,
        dilation,
    ),
]
