"""A bar that is pulled at both ends, at rest: uniaxial stress, and none across."""

from typing import Any

import numpy as np
import torch

import pcnclaws as pc
from benchmarks.verification.case import Case, Outcome, Table, many_numbers
from benchmarks.verification.motion_bar import KELVIN_VOIGT
from benchmarks.verification.motion_scenes import NO_GRAVITY, array, box, deformation_of

SPACING, YOUNG, POISSON, TRACTION = 0.1, 1000.0, 0.2, -1.0
SIDES = (1.6, 0.4, 0.4)


def pressed() -> Outcome:
    """Cauchy stresses in the middle of a bar that two forces press together, damped until it rests."""
    body = box((0.0, 0.0, 0.0), SIDES, (32, 8, 8))
    force = TRACTION * SIDES[1] * SIDES[2]
    ends = [(0.0, 2.0 * SPACING, -force), (SIDES[0] - 2.0 * SPACING, SIDES[0], force)]
    loads = [pc.Load(low=(low, -1, -1), high=(high, 1, 1), force=(push, 0, 0)) for low, high, push in ends]
    settings = pc.Settings(domain=None, grid_spacing=SPACING, gravity=NO_GRAVITY, density=1.0, time_step=2e-4)
    moduli: dict[str, Any] = {"youngs_modulus": YOUNG, "poissons_ratio": POISSON}
    law = pc.analytic_law(KELVIN_VOIGT)
    scene = pc.Scene(body, law, settings=settings, loads=loads, viscosity=6.0, **moduli)
    motion = scene.simulate(6000, 6000, dtype=torch.float64, deformation=True)
    deformation = deformation_of(motion)[-1]
    stress = law.stress(deformation, **moduli) / torch.linalg.det(deformation)[:, None, None]
    x = array(body.position)[:, 0]
    middle = np.abs(x - 0.5 * SIDES[0]) < SPACING
    mean = array(stress)[middle].mean(0)
    lines = [["along the bar", f"{mean[0, 0]:.6f}", "-1"], ["across it", f"{mean[1, 1]:.1e}", "0"]]
    ours, theirs = [mean[0, 0], mean[1, 1], mean[2, 2], mean[0, 1]], [TRACTION, 0.0, 0.0, 0.0]
    return many_numbers(ours, theirs, "Pa", table=Table(["mean in the middle", "ours [Pa]", "theirs [Pa]"], lines))


CASES = [
    Case(
        "uniaxial_stress",
        "motion",
        "A bar that is pressed with 1 Pa at its ends comes to rest with a stress of -1 Pa along it and none across.",
        "closed form; numbers of CB-Geo, mpm-doc, uniaxial stress: E 1000 Pa, nu 0.2, -1.0",
        1e-2,
        pressed,
        slow=True,
    ),
]
