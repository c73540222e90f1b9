"""Silicone: neo-Hookean beside Maxwell elements, whose moduli fall with a power of their relaxation times.

With the exponent 0 the loss factor is nearly constant over the times of the elements (structural damping); with a
steep power the shortest element alone is left, which far below 1 / (2 pi t_1) is a Newtonian viscosity that bounds no
time step. In between it is a spring beside a springpot, the fractional Kelvin-Voigt model of rubber.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from torch import Tensor

from pcnclaws.laws.base import Elasticity, Plasticity
from pcnclaws.laws.formulas import TIME_STEP
from pcnclaws.laws.internal_variables import InternalVariable
from pcnclaws.laws.materials import Material
from pcnclaws.laws.moduli import lame_constants
from pcnclaws.laws.parameters import POISSONS_RATIO, YOUNGS_MODULUS, Parameter
from pcnclaws.tensors.linalg3 import determinant, identity_like, matmul, transpose
from pcnclaws.tensors.tensor_types import Matrices, Parameters

# Of the elements [s]: from far below a period of the beam to the length of a recording, a factor of 7 apart.
RELAXATION_TIMES = (0.002, 0.0141421356, 0.1, 0.707106781, 5.0)
# The exponent of a viscosity: of the second element 1e-8 is left.
VISCOUS = 10.0
STRENGTHS = tuple(
    Parameter(f"strength_{k + 1}", f"g{k + 1}", "-", lower_included=True, logarithmic=True, search=(1e-4, 1e2))
    for k in range(len(RELAXATION_TIMES))
)
PLACES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
STRAINS = tuple(
    tuple(InternalVariable(f"strain_{k + 1}_{i}{j}") for i, j in PLACES) for k in range(len(RELAXATION_TIMES))
)
ALL_STRAINS = tuple(one for strain in STRAINS for one in strain)


def strengths(first: float, exponent: float) -> np.ndarray:
    """Moduli of the elements over that of the spring [-], (elements,): g_k = g_1 (t_k / t_1)^-exponent."""
    return first * (np.asarray(RELAXATION_TIMES) / RELAXATION_TIMES[0]) ** -exponent


def complex_modulus(moduli: np.ndarray, frequency: float) -> complex:
    """The shear modulus in harmonic motion over the long-term one [-], 1 + sum g_k i w t_k / (1 + i w t_k).

    moduli     of the elements over that of the spring [-], (elements,)
    frequency  [Hz]
    """
    turned = 2j * np.pi * frequency * np.asarray(RELAXATION_TIMES)
    return complex(1.0 + np.sum(moduli * turned / (1.0 + turned)))


def green_lagrange(deformation: Matrices) -> Matrices:
    """Strain of Green and Lagrange, (F^T F - I) / 2 [-], (3, 3, particles)."""
    return 0.5 * (matmul(transpose(deformation), deformation) - identity_like(deformation))


class Silicone(Elasticity):
    """Neo-Hookean elasticity beside Maxwell elements.

        tau = mu (F F^T - I) + lambda ln(J) I + F sum_k 2 g_k mu dev(E - E_k) F^T

    source  Simo 1987, "On a fully three-dimensional finite-strain viscoelastic damage model"
    """

    physical_parameters = (YOUNGS_MODULUS, POISSONS_RATIO, *STRENGTHS)
    internal_variables = ALL_STRAINS

    def evaluate(self, deformation: Matrices, known: Parameters) -> tuple[Matrices, Mapping[str, Tensor]]:
        lam, mu = lame_constants(known)
        strain = green_lagrange(deformation)
        extra = torch.zeros_like(strain)
        for strength, names in zip(STRENGTHS, STRAINS, strict=True):
            extra = extra + known[strength.name] * (strain - _symmetric(known, names))
        extra = extra - (extra[0, 0] + extra[1, 1] + extra[2, 2]) / 3.0 * identity_like(deformation)
        # mu F F^T and the stress of the elements turn together
        inner = mu * (2.0 * extra + identity_like(deformation))
        pressure = lam * determinant(deformation).log() - mu
        turned = matmul(matmul(deformation, inner), transpose(deformation))
        return turned + pressure * identity_like(deformation), {}

    def kirchhoff_stress(self, deformation: Matrices, parameters: Parameters) -> Matrices:
        """Kirchhoff stress tau [Pa], (3, 3, particles); without internal variables that of a sudden deformation."""
        still = {one.name: torch.zeros_like(deformation[0, 0]) for one in ALL_STRAINS}
        return self.evaluate(deformation, {**still, **parameters})[0]


class Following(Plasticity):
    """The strains of the dashpots, implicit in time: E_k' = E_k + dt / (t_k + dt) (E - E_k); F stays as it is."""

    physical_parameters = ()
    internal_variables = ALL_STRAINS
    reads_time_step = True

    def evaluate(self, deformation: Matrices, known: Parameters) -> tuple[Matrices, Mapping[str, Tensor]]:
        strain = green_lagrange(deformation)
        after: dict[str, Tensor] = {}
        for time, names in zip(RELAXATION_TIMES, STRAINS, strict=True):
            share = known[TIME_STEP] / (time + known[TIME_STEP])
            after |= {
                one.name: torch.lerp(known[one.name], strain[place], share)
                for one, place in zip(names, PLACES, strict=True)
            }
        return deformation, after

    def return_map(self, trial: Matrices, parameters: Parameters) -> Matrices:
        """The trial deformation [-], (3, 3, particles): nothing flows for good."""
        return trial


SILICONE = Material(
    "silicone",
    Silicone,
    Following,
    {"youngs_modulus": (1e5, 5e5), "poissons_ratio": (0.3, 0.49), **{one.name: (0.0, 2.0) for one in STRENGTHS}},
)


def _symmetric(known: Mapping[str, Any], names: tuple[InternalVariable, ...]) -> Matrices:
    xx, yy, zz, xy, xz, yz = (known[one.name] for one in names)
    return torch.stack((torch.stack((xx, xy, xz)), torch.stack((xy, yy, yz)), torch.stack((xz, yz, zz))))
