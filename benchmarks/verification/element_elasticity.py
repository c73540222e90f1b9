"""Elastic laws in uniaxial stress, simple shear and hydrostatic deformation, against closed forms.

The closed forms are written in stretches and in b = F F^T, from the textbook; nothing of the package is used in them.
"""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from torch import Tensor

import pcnclaws as pc
from benchmarks.verification.case import Case, Curve, Line, Outcome, many_numbers
from benchmarks.verification.element_paths import diagonal, simple_shear

YOUNG, POISSON = 3e5, 0.3
MU, LAM = YOUNG / 2.6, YOUNG * 0.3 / (1.3 * 0.4)
PARAMETERS: dict[str, Any] = {"youngs_modulus": YOUNG, "poissons_ratio": POISSON}
# Hencky strains, stretches and amounts of shear of the paths [-].
LARGE = 0.3


class Path(NamedTuple):
    """A path: F, what is measured along it, and the components of the stress that are known there.

    stresses  by name of the component: row, column and the closed form [Pa]
    """

    along: str
    x: np.ndarray
    deformation: Tensor
    stresses: Mapping[str, tuple[int, int, np.ndarray]]


def hencky_uniaxial(size: float) -> Path:
    """tau_1 = E h_1, h_2 = h_3 = -nu h_1."""
    h = np.linspace(-size, size, 41)
    f = diagonal(np.exp(h), np.exp(-POISSON * h), np.exp(-POISSON * h))
    return Path("axial Hencky strain [-]", h, f, _axial(YOUNG * h))


def neo_hookean_uniaxial(size: float) -> Path:
    """No lateral stress: ln J = -mu / lambda (s_2^2 - 1), and s_1 = J / s_2^2."""
    lateral = np.exp(np.linspace(POISSON * size, -POISSON * size, 41))
    volume = np.exp(MU * (1.0 - lateral**2) / LAM)
    axial = volume / lateral**2
    return Path(
        "axial Hencky strain [-]",
        np.log(axial),
        diagonal(axial, lateral, lateral),
        _axial(MU * (axial**2 - lateral**2)),
    )


def corotated_uniaxial(size: float) -> Path:
    """No lateral stress: J (J - 1) = -2 mu / lambda (s_2 - 1) s_2, and s_1 = J / s_2^2."""
    lateral = np.exp(np.linspace(POISSON * size, -POISSON * size, 41))
    pressure = -2.0 * MU * (lateral - 1.0) * lateral
    volume = 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * pressure / LAM))
    axial = volume / lateral**2
    stress = 2.0 * MU * (axial - 1.0) * axial + pressure
    return Path("axial Hencky strain [-]", np.log(axial), diagonal(axial, lateral, lateral), _axial(stress))


def hencky_shear(size: float) -> Path:
    """Principal Hencky strains +-asinh(gamma / 2), whose axes stand at tan(2 theta) = 2 / gamma."""
    gamma = np.linspace(-size, size, 41)
    strain, root = np.arcsinh(0.5 * gamma), np.sqrt(4.0 + gamma**2)
    return _sheared(gamma, 4.0 * MU * strain / root, 2.0 * MU * strain * gamma / root)


def neo_hookean_shear(size: float) -> Path:
    """tau_12 = mu gamma, tau_11 = mu gamma^2."""
    gamma = np.linspace(-size, size, 41)
    return _sheared(gamma, MU * gamma, MU * gamma**2)


def corotated_shear(size: float) -> Path:
    """tau = 2 mu (b - sqrt(b)) with sqrt(b) = (b + I) / sqrt(4 + gamma^2) in the plane."""
    gamma = np.linspace(-size, size, 41)
    root = np.sqrt(4.0 + gamma**2)
    along = 2.0 * MU * (1.0 + gamma**2 - (2.0 + gamma**2) / root)
    return _sheared(gamma, 2.0 * MU * gamma * (1.0 - 1.0 / root), along)


def hydrostatic(stress: Callable[[np.ndarray], np.ndarray], size: float) -> Path:
    """All stretches alike."""
    stretch = np.exp(np.linspace(-size, size, 41) / 3.0)
    known = {f"{axis}{axis}": (axis, axis, stress(stretch)) for axis in range(3)}
    return Path("volumetric Hencky strain [-]", 3.0 * np.log(stretch), diagonal(stretch, stretch, stretch), known)


def hencky_pressure(stretch: np.ndarray) -> np.ndarray:
    """(2 mu + 3 lambda) ln s."""
    return (2.0 * MU + 3.0 * LAM) * np.log(stretch)


def neo_hookean_pressure(stretch: np.ndarray) -> np.ndarray:
    """Mu (s^2 - 1) + 3 lambda ln s."""
    return MU * (stretch**2 - 1.0) + 3.0 * LAM * np.log(stretch)


def corotated_pressure(stretch: np.ndarray) -> np.ndarray:
    """2 mu (s - 1) s + lambda J (J - 1), J = s^3."""
    return 2.0 * MU * (stretch - 1.0) * stretch + LAM * stretch**3 * (stretch**3 - 1.0)


def _axial(stress: np.ndarray) -> dict[str, tuple[int, int, np.ndarray]]:
    nothing = np.zeros_like(stress)
    return {"axial": (0, 0, stress), "lateral": (1, 1, nothing), "shear": (0, 1, nothing)}


def _sheared(gamma: np.ndarray, shear: np.ndarray, along: np.ndarray) -> Path:
    known = {"shear": (0, 1, shear), "normal": (0, 0, along)}
    return Path("amount of shear [-]", gamma, simple_shear(gamma), known)


Paths = Mapping[str, Callable[[float], Path]]
HENCKY: Paths = {
    "uniaxial": hencky_uniaxial,
    "shear": hencky_shear,
    "hydrostatic": partial(hydrostatic, hencky_pressure),
}
NEO_HOOKEAN: Paths = {
    "uniaxial": neo_hookean_uniaxial,
    "shear": neo_hookean_shear,
    "hydrostatic": partial(hydrostatic, neo_hookean_pressure),
}
COROTATED: Paths = {
    "uniaxial": corotated_uniaxial,
    "shear": corotated_shear,
    "hydrostatic": partial(hydrostatic, corotated_pressure),
}
LAWS: Mapping[str, tuple[str, Paths]] = {
    "sand": ("StVK in Hencky strain", HENCKY),
    "neo_hookean": ("neo-Hookean elasticity", NEO_HOOKEAN),
    "elasticity": ("fixed corotated elasticity", COROTATED),
}
WORDS = {
    "uniaxial": "uniaxial stress",
    "shear": "simple shear",
    "hydrostatic": "hydrostatic deformation",
}


def compared(law: pc.ConstitutiveModel, path: Path) -> Outcome:
    """The stresses of a law along a path beside the closed form, relative to the largest of them."""
    stress = law.stress(path.deformation, **PARAMETERS).detach().numpy()
    lines = [
        Line(name, path.x, stress[:, row, column], theirs) for name, (row, column, theirs) in path.stresses.items()
    ]
    ours, theirs = (np.concatenate([np.asarray(getattr(line, who)) for line in lines]) for who in ("ours", "theirs"))
    shown = [line for line in lines if np.any(line.theirs)]
    return many_numbers(ours, theirs, "Pa", curve=Curve(path.along, "Kirchhoff stress [Pa]", _distinct(shown)))


def _distinct(lines: list[Line]) -> list[Line]:
    """One line where all have the same closed form."""
    same = all(np.array_equal(line.theirs, lines[0].theirs) for line in lines)
    return lines[:1] if same else lines


def _case(material: str, path: str) -> Case:
    words, paths = LAWS[material]
    return Case(
        f"{material}_{path}",
        "laws",
        f"{words[0].upper()}{words[1:]} follows its closed form in {WORDS[path]} up to strains of +-{LARGE:g}.",
        "closed form",
        1e-10,
        lambda: compared(pc.analytic_law(material), paths[path](LARGE)),
    )


CASES = [_case(material, path) for material in LAWS for path in WORDS]
