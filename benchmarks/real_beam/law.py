"""Silicone: neo-Hookean, with a viscosity whose stress follows the rate of strain within a relaxation time.

A Newtonian viscosity bounds the time step by dx^2 rho / (8/3 eta), a tenth of what waves allow here, and each step of
APIC damps. A Maxwell element of modulus eta / t_r, with t_r far below the period, is the same viscosity to
(omega t_r)^2 and bounds nothing.
"""

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from pcnclaws.laws.base import Elasticity, Plasticity
from pcnclaws.laws.formulas import TIME_STEP
from pcnclaws.laws.internal_variables import InternalVariable
from pcnclaws.laws.materials import Material
from pcnclaws.laws.moduli import lame_constants
from pcnclaws.laws.parameters import POISSONS_RATIO, VISCOSITY, YOUNGS_MODULUS, Parameter
from pcnclaws.tensors.linalg3 import determinant, identity_like, matmul, transpose
from pcnclaws.tensors.tensor_types import Matrices, Parameters

RELAXATION_TIME = Parameter("relaxation_time", "t_r", "s", logarithmic=True, search=(1e-5, 1e2))
# Of the Maxwell element [s]: omega t_r is 0.1 at 8 Hz.
FOLLOWING = 2e-3
PLACES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
STRAINS = tuple(InternalVariable(f"viscous_strain_{i}{j}") for i, j in PLACES)


def green_lagrange(deformation: Matrices) -> Matrices:
    """Strain of Green and Lagrange, (F^T F - I) / 2 [-], (3, 3, particles)."""
    return 0.5 * (matmul(transpose(deformation), deformation) - identity_like(deformation))


class Silicone(Elasticity):
    """Neo-Hookean elasticity beside a Maxwell element.

        tau = mu (F F^T - I) + lambda ln(J) I + F 2 (eta / t_r) dev(E - E_v) F^T

    source  Simo 1987, "On a fully three-dimensional finite-strain viscoelastic damage model"
    """

    physical_parameters = (YOUNGS_MODULUS, POISSONS_RATIO, VISCOSITY, RELAXATION_TIME)
    internal_variables = STRAINS

    def evaluate(self, deformation: Matrices, known: Parameters) -> tuple[Matrices, Mapping[str, Tensor]]:
        lam, mu = lame_constants(known)
        extra = green_lagrange(deformation) - _symmetric(known)
        extra = extra - (extra[0, 0] + extra[1, 1] + extra[2, 2]) / 3.0 * identity_like(deformation)
        # mu F F^T and the stress of the element turn together
        inner = 2.0 * known["viscosity"] / known["relaxation_time"] * extra + mu * identity_like(deformation)
        pressure = lam * determinant(deformation).log() - mu
        turned = matmul(matmul(deformation, inner), transpose(deformation))
        return turned + pressure * identity_like(deformation), {}

    def kirchhoff_stress(self, deformation: Matrices, parameters: Parameters) -> Matrices:
        """Kirchhoff stress tau [Pa], (3, 3, particles); without internal variables that of a sudden deformation."""
        still = {one.name: torch.zeros_like(deformation[0, 0]) for one in STRAINS}
        return self.evaluate(deformation, {**still, **parameters})[0]


class Following(Plasticity):
    """The strain of the dashpot, implicit in time: E_v' = E_v + dt / (t_r + dt) (E - E_v); F stays as it is."""

    physical_parameters = (RELAXATION_TIME,)
    internal_variables = STRAINS
    reads_time_step = True

    def evaluate(self, deformation: Matrices, known: Parameters) -> tuple[Matrices, Mapping[str, Tensor]]:
        share = known[TIME_STEP] / (known["relaxation_time"] + known[TIME_STEP])
        strain = green_lagrange(deformation)
        return deformation, {
            one.name: torch.lerp(known[one.name], strain[place], share)
            for one, place in zip(STRAINS, PLACES, strict=True)
        }

    def return_map(self, trial: Matrices, parameters: Parameters) -> Matrices:
        """The trial deformation [-], (3, 3, particles): nothing flows for good."""
        return trial


SILICONE = Material(
    "silicone",
    Silicone,
    Following,
    {
        "youngs_modulus": (1e5, 5e5),
        "poissons_ratio": (0.3, 0.49),
        "viscosity": (0.0, 1e3),
        "relaxation_time": (1e-3, 3e-3),
    },
)


def _symmetric(known: Mapping[str, Any]) -> Matrices:
    xx, yy, zz, xy, xz, yz = (known[one.name] for one in STRAINS)
    return torch.stack((torch.stack((xx, xy, xz)), torch.stack((xy, yy, yz)), torch.stack((xz, yz, zz))))
