"""A law from outside of the package that relaxes: a spring beside a Maxwell branch, Zener's standard linear solid."""

from collections.abc import Mapping

import torch
from torch import Tensor

from benchmarks.remembering_material import RELAXATION_TIME
from pcnclaws.laws.base import Elasticity, Plasticity
from pcnclaws.laws.internal_variables import InternalVariable
from pcnclaws.laws.materials import Material
from pcnclaws.laws.moduli import lame_constants
from pcnclaws.laws.parameters import POISSONS_RATIO, YOUNGS_MODULUS, Parameter
from pcnclaws.tensors.linalg3 import deviator, hencky_strain, trace
from pcnclaws.tensors.tensor_types import Matrices, Parameters

BRANCH = Parameter("branch_modulus", "mu_1", "Pa", logarithmic=True, search=(1.0, 1e9), is_stress=True)
PLACES = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]
LAST = [InternalVariable(f"strain_{i}{j}") for i, j in PLACES]
IN_BRANCH = [InternalVariable(f"branch_strain_{i}{j}") for i, j in PLACES]


class ZenerElasticity(Elasticity):
    """tau = 2 mu dev h + K tr(h) I + 2 mu_1 q,  h the Hencky strain, q the strain of the spring of the branch."""

    physical_parameters = (YOUNGS_MODULUS, POISSONS_RATIO, BRANCH)
    internal_variables = tuple(IN_BRANCH)

    def kirchhoff_stress(self, deformation: Matrices, parameters: Parameters) -> Matrices:
        lam, mu = lame_constants(parameters)
        h = hencky_strain(deformation)
        volume = (lam + 2.0 / 3.0 * mu) * trace(h) * torch.eye(3).to(h)[:, :, None]
        q = _symmetric([parameters[one.name] for one in IN_BRANCH])
        return 2.0 * mu * deviator(h) + volume + 2.0 * parameters["branch_modulus"] * q


class ZenerBranch(Plasticity):
    """dq/dt + q / t_r = d(dev h)/dt: exact for strains that change at a steady rate within a step.

        q' = e^(-dt / t_r) q + (1 - e^(-dt / t_r)) t_r / dt (dev h' - dev h)

    F stays as it is. The components do not turn with the body: the law is for strains along fixed axes.
    """

    physical_parameters = (RELAXATION_TIME,)
    internal_variables = (*LAST, *IN_BRANCH)
    reads_time_step = True

    def evaluate(self, deformation: Matrices, known: Parameters) -> tuple[Matrices, Mapping[str, Tensor]]:
        strain = deviator(hencky_strain(deformation))
        elapsed = known["time_step"] / known["relaxation_time"]
        kept, taken = torch.exp(-elapsed), -torch.expm1(-elapsed) / elapsed
        changed: dict[str, Tensor] = {}
        for (i, j), last, branch in zip(PLACES, LAST, IN_BRANCH, strict=True):
            changed[last.name] = strain[i, j]
            changed[branch.name] = kept * known[branch.name] + taken * (strain[i, j] - known[last.name])
        return deformation, changed


def _symmetric(six: list[Tensor]) -> Matrices:
    places = dict(zip(PLACES, six, strict=True))
    rows = [[places[min(i, j), max(i, j)] for j in range(3)] for i in range(3)]
    return torch.stack([torch.stack(torch.broadcast_tensors(*row)) for row in rows])


ZENER = Material(
    "zener",
    ZenerElasticity,
    ZenerBranch,
    {
        "youngs_modulus": (1e4, 1e6),
        "poissons_ratio": (0.1, 0.4),
        "branch_modulus": (1e4, 1e6),
        "relaxation_time": (1e-2, 1.0),
    },
)
