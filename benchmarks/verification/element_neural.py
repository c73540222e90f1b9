"""The laws that ship, through the cases of the analytic ones: elastic paths, yield stress, friction angle."""

import math
from collections.abc import Callable
from functools import partial

import numpy as np
import torch

import pcnclaws as pc
from benchmarks.verification.case import Case, Curve, Line, Outcome, Table, many_numbers, one_number
from benchmarks.verification.element_elasticity import LAWS, WORDS, compared
from benchmarks.verification.element_paths import at_constant_lateral_stress, diagonal, shipped_law

SIZES = (0.02, 0.05, 0.1, 0.3)
# Largest strain that the row is judged by: twice what bodies of the training data mostly reach.
JUDGED = 0.05
ANGLES = np.arange(10.0, 46.0, 5.0)
PRESSURES = (300.0, 3e3, 3e4)
# Directions of the deviator of strain: compression, shear and extension of the textbook's triaxial tests.
LODE = {"compression": (-2.0, 1.0, 1.0), "shear": (-1.0, 0.0, 1.0), "extension": (2.0, -1.0, -1.0)}
YOUNG, POISSON = 4e5, 0.25
MU, BULK = YOUNG / 2.5, YOUNG / 1.5
INCREMENTS = 150


def elastic_paths(material: str, closed_form: str) -> Outcome:
    """The path of the three that is worst at the judged strain; a table of all at all sizes."""
    law, paths = shipped_law(material), LAWS[closed_form][1]
    found = {(name, size): compared(law, path(size)) for name, path in paths.items() for size in SIZES}
    lines = [[WORDS[name], *(f"{found[name, size].difference:.1e}" for size in SIZES)] for name in paths]
    judged = max((found[name, JUDGED] for name in paths), key=lambda outcome: outcome.difference)
    table = Table(["relative difference", *(f"strains to {size:g}" for size in SIZES)], lines)
    return Outcome(**{**vars(judged), "table": table})


def uniaxial_yield() -> Outcome:
    """The stress at which the shipped plasticine flows in uniaxial compression."""
    parameters = {"youngs_modulus": 4e5, "poissons_ratio": 0.3, "yield_stress": 4e3}
    axial = -np.linspace(0.0, 0.05, 26)[1:]
    stress = at_constant_lateral_stress(shipped_law("plasticine"), axial, 0.0, parameters)
    yielded = math.sqrt(1.5) * 4e3
    line = Line("plasticine", -axial, -stress[:, 0], np.minimum(-4e5 * axial, yielded))
    curve = Curve("axial Hencky strain [-]", "axial stress [Pa]", [line])
    return one_number(-float(stress[-1, 0]), yielded, "Pa", curve=curve)


def realised_angles(law: pc.ConstitutiveModel) -> np.ndarray:
    """The friction angles [deg] at which sand flows, (angles asked for, pressures, Lode angles).

    From an isotropic state the deviator of strain grows in equal steps; under pressure the flow keeps the volume. The
    angle is that of the outer cone, sin(phi) = 3 M / (6 + M) with M = q / p.
    """
    angle, pressure, lode = np.meshgrid(ANGLES, PRESSURES, np.arange(len(LODE)), indexing="ij")
    size = pressure[..., None] / MU
    direction = np.array([*LODE.values()])[lode]
    direction = direction / np.linalg.norm(direction, axis=-1, keepdims=True)
    start, increment = np.exp(-pressure / (3.0 * BULK)), np.exp(3.0 * size * direction / INCREMENTS)
    parameters = {"youngs_modulus": YOUNG, "poissons_ratio": POISSON, "friction_angle": torch.from_numpy(angle)}
    elastic, step = diagonal(start, start, start), diagonal(*np.moveaxis(increment, -1, 0))
    for _ in range(INCREMENTS):
        elastic = law.return_map(step @ elastic, **parameters).detach()
    stress = law.stress(elastic, **parameters).detach().diagonal(dim1=-2, dim2=-1).numpy()
    mean = stress.mean(-1)
    ratio = math.sqrt(1.5) * np.linalg.norm(stress - mean[..., None], axis=-1) / -mean
    return np.degrees(np.arcsin(3.0 * ratio / (6.0 + ratio)))


def friction_angles(load: Callable[[str], pc.ConstitutiveModel], between: tuple[float, float]) -> Outcome:
    """The angle realised against the one asked for, judged between two angles; a table of all, and a picture."""
    found = realised_angles(load("sand"))
    asked = np.broadcast_to(ANGLES[:, None, None], found.shape)
    names = [f"{pressure / 1e3:g} kPa, {lode}" for pressure in PRESSURES for lode in LODE]
    lines = [[f"{angle:g}", *(f"{one:.2f}" for one in row.ravel())] for angle, row in zip(ANGLES, found, strict=True)]
    low, high = between
    judged = (low <= ANGLES) & (high >= ANGLES)
    curve = Curve(
        "friction angle asked for [deg]",
        "friction angle realised [deg]",
        [Line(name, ANGLES, found.reshape(len(ANGLES), -1)[:, k], ANGLES) for k, name in enumerate(names)],
    )
    worst = many_numbers(found[judged], asked[judged])
    error = abs(worst.ours - worst.theirs) / worst.theirs
    return Outcome(worst.ours, worst.theirs, error, "deg", curve, Table(["asked for [deg]", *names], lines))


SHIPPED = {"elasticity": "elasticity", "plasticine": "sand", "sand": "sand"}
CASES = [
    Case(
        "friction_angle",
        "laws",
        "Sand flows at the friction angle asked for, 10 to 45 degrees, at any pressure and Lode angle.",
        "closed form, Drucker and Prager 1952, outer fit of Mohr-Coulomb",
        1e-9,
        partial(friction_angles, pc.analytic_law, (10.0, 45.0)),
    ),
]
NEURAL_CASES = [
    *(
        Case(
            f"neural_{material}_paths",
            "neural laws",
            f"The shipped elastic law of {material} follows {LAWS[form][0]} in uniaxial stress, simple shear and "
            f"hydrostatic deformation up to strains of +-{JUDGED:g}.",
            "closed form",
            1e-2,
            partial(elastic_paths, material, form),
        )
        for material, form in SHIPPED.items()
    ),
    Case(
        "neural_yield_plasticine",
        "neural laws",
        "The shipped law of plasticine yields at sqrt(3/2) tau_Y in uniaxial compression.",
        "closed form, Mises 1913",
        1e-2,
        uniaxial_yield,
        slow=True,
    ),
    Case(
        "neural_friction_angle",
        "neural laws",
        "The shipped law of sand flows at the friction angle asked for between 20 and 35 degrees, where it was "
        "trained (18 to 38), at any pressure and Lode angle.",
        "closed form, Drucker and Prager 1952, outer fit of Mohr-Coulomb",
        1e-2,
        partial(friction_angles, shipped_law, (20.0, 35.0)),
    ),
]
