"""Von Mises: perfect, with Voce hardening and with Perzyna's rate, against an independent solver."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

import pcnclaws as pc
from benchmarks.verification.case import Case, Curve, Line, Outcome, lines_of, one_number
from benchmarks.verification.element_paths import at_constant_lateral_stress, driven, numbers_of
from benchmarks.verification.hardening_laws import PERZYNA, VOCE
from pcnclaws.compiled.backend import using_backend

NEML2 = "NEML2, tests/verification/solid_mechanics/{}.csv, rtol 1e-5"
MEGA = 1e6


def _against_neml2(file: str, law: pc.ConstitutiveModel, parameters: Mapping[str, float], timed: bool) -> Outcome:
    """All three principal stresses along the strains of the file; Hencky strains take the part of small strains."""
    table = numbers_of(file)
    strains = np.stack([table[f"strain_{axis}{axis}"] for axis in "xyz"], axis=1)
    # kernels of laws with inner iterations take half a minute to compile
    with using_backend("torch" if law.internal_names else "auto"):
        ours = driven(law, strains, parameters, table["time"] if timed else None) / MEGA
    theirs = np.stack([table[f"stress_{axis}{axis}"] for axis in "xyz"], axis=1)
    lines = [Line("axial", strains[:, 0], ours[:, 0], theirs[:, 0])]
    curve = Curve("axial strain [-]", "axial stress [MPa]", lines)
    lateral = np.abs(ours[:, 1:] - theirs[:, 1:]).max() / np.abs(theirs[:, 0]).max()
    axial = lines_of(curve, "MPa")
    return axial if axial.difference > lateral else Outcome(**{**vars(axial), "difference": lateral})


def perfect() -> Outcome:
    """Plasticine with tau_Y = sqrt(2/3) sigma_Y."""
    parameters = {"youngs_modulus": 120e9, "poissons_ratio": 0.3, "yield_stress": np.sqrt(2.0 / 3.0) * 100e6}
    return _against_neml2("perfect.csv", pc.analytic_law("plasticine"), parameters, timed=False)


def voce() -> Outcome:
    """A law of one's own that remembers its plastic strain."""
    parameters = {"youngs_modulus": 120e9, "poissons_ratio": 0.3, "uniaxial_yield_stress": 100e6}
    hardening = {"saturation_stress": 100e6, "saturation_rate": 10.0}
    return _against_neml2("voceiso.csv", pc.analytic_law(VOCE), parameters | hardening, timed=False)


def perzyna() -> Outcome:
    """A law of one's own whose flow takes the time of the file."""
    parameters = {"youngs_modulus": 124e9, "poissons_ratio": 0.32, "uniaxial_yield_stress": 10e6}
    rate = {"linear_hardening": 5500e6, "reference_stress": 500e6}
    return _against_neml2("isolinear_uniaxial.csv", pc.analytic_law(PERZYNA), parameters | rate, timed=True)


def uniaxial_yield(name: str, factor: float) -> Callable[[], Outcome]:
    """The stress at which a bar flows that is compressed without lateral stress, over the yield stress."""

    def measured() -> Outcome:
        parameters = {"youngs_modulus": 4e5, "poissons_ratio": 0.3, "yield_stress": 4e3}
        axial = -np.linspace(0.0, 0.05, 26)[1:]
        stress = at_constant_lateral_stress(pc.analytic_law(name), axial, 0.0, parameters)
        yielded = factor * 4e3
        line = Line(name, -axial, -stress[:, 0], np.minimum(-4e5 * axial, yielded))
        shown: dict[str, Any] = {"curve": Curve("axial Hencky strain [-]", "axial stress [Pa]", [line])}
        return one_number(-float(stress[-1, 0]), yielded, "Pa", **shown)

    return measured


CASES = [
    Case(
        "j2_perfect",
        "laws",
        "Perfect von Mises plasticity follows an independent solver through yield, in axial and lateral stress.",
        NEML2.format("rate_independent/perfect"),
        1e-5,
        perfect,
    ),
    Case(
        "j2_voce",
        "laws",
        "A law of one's own with an internal variable, Voce hardening, follows an independent solver.",
        NEML2.format("rate_independent/voceiso"),
        1e-5,
        voce,
        slow=True,
    ),
    Case(
        "j2_perzyna",
        "laws",
        "A law of one's own whose flow takes time, Perzyna with linear hardening, follows an independent solver.",
        NEML2.format("perzyna/isolinear_uniaxial"),
        1e-5,
        perzyna,
        slow=True,
    ),
    Case(
        "yield_plasticine",
        "laws",
        "Plasticine in uniaxial compression yields at sqrt(3/2) tau_Y.",
        "closed form, Mises 1913",
        1e-9,
        uniaxial_yield("plasticine", float(np.sqrt(1.5))),
    ),
    Case(
        "yield_tresca",
        "laws",
        "A Tresca body in uniaxial compression yields at sqrt(2) tau_Y.",
        "closed form, Tresca 1864",
        1e-9,
        uniaxial_yield("tresca", float(np.sqrt(2.0))),
    ),
]
