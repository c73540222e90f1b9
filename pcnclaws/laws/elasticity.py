"""Analytic elasticity: the ground truth that neural laws are trained on and compared with."""

from collections.abc import Sequence

import torch
from torch import Tensor

from pcnclaws.laws.base import Elasticity
from pcnclaws.laws.parameters import lame_constants
from pcnclaws.linalg3 import determinant, hencky_strain, identity_like, left_stretch, matmul, trace, transpose
from pcnclaws.tensor_types import Matrices, Parameters


class FixedCorotated(Elasticity):
    """Fixed corotated elasticity, the material of soft elastic bodies."""

    parameter_names = ("youngs_modulus", "poissons_ratio")
    kernel = "FixedCorotated"

    def kernel_parameters(self, parameters: Parameters) -> Sequence[Tensor]:
        return lame_constants(parameters)[::-1]

    def kirchhoff_stress(self, deformation: Matrices, parameters: Parameters) -> Matrices:
        """Kirchhoff stress of the fixed corotated energy.

            tau = 2 mu (F - R) F^T + lambda J (J - 1) I = 2 mu (b - V) + lambda J (J - 1) I

        with the polar decomposition F = V R, b = V^2 = F F^T and J = det F.

        deformation  elastic deformation gradient F [-], (3, 3, particles), det F > 0
        parameters   youngs_modulus [Pa], poissons_ratio [-], each (particles,)
        returns      tau [Pa], (3, 3, particles), symmetric
        source       Stomakhin et al. 2012, "Energetically consistent invertible elasticity"
        """
        lam, mu = lame_constants(parameters)
        v, b = left_stretch(deformation)
        j = determinant(deformation.double())
        stress = 2.0 * mu * (b - v) + identity_like(b) * (lam * j * (j - 1.0))
        return stress.to(deformation.dtype)


class NeoHookean(Elasticity):
    """Compressible neo-Hookean elasticity, a rubber that the Hencky form of the neural laws does not contain."""

    parameter_names = ("youngs_modulus", "poissons_ratio")
    kernel = "NeoHookean"

    def kernel_parameters(self, parameters: Parameters) -> Sequence[Tensor]:
        return lame_constants(parameters)[::-1]

    def kirchhoff_stress(self, deformation: Matrices, parameters: Parameters) -> Matrices:
        """Kirchhoff stress of the compressible neo-Hookean energy mu/2 (tr b - 3) - mu ln J + lambda/2 (ln J)^2.

            tau = mu (b - I) + lambda ln(J) I,   b = F F^T,   J = det F

        deformation  elastic deformation gradient F [-], (3, 3, particles), det F > 0
        parameters   youngs_modulus [Pa], poissons_ratio [-], each (particles,)
        returns      tau [Pa], (3, 3, particles), symmetric
        source       Bonet and Wood 2008, "Nonlinear continuum mechanics for finite element analysis", section 6.4.3,
                     where it stands as the Cauchy stress tau / J
        """
        lam, mu = lame_constants(parameters)
        f = deformation.double()  # b - I and ln J of small strains are differences of numbers near 1
        b = matmul(f, transpose(f))
        identity = identity_like(b)
        stress = mu * (b - identity) + identity * (lam * torch.log(determinant(f)))
        return stress.to(deformation.dtype)


class StVKHencky(Elasticity):
    """St. Venant-Kirchhoff elasticity in Hencky strain, the elastic part of sand and plasticine."""

    parameter_names = ("youngs_modulus", "poissons_ratio")
    kernel = "StVKHencky"

    def kernel_parameters(self, parameters: Parameters) -> Sequence[Tensor]:
        return lame_constants(parameters)[::-1]

    def kirchhoff_stress(self, deformation: Matrices, parameters: Parameters) -> Matrices:
        """Kirchhoff stress of the Hencky form of St. Venant-Kirchhoff elasticity.

            tau = 2 mu h + lambda tr(h) I,   h = 1/2 log(F F^T)

        deformation  elastic deformation gradient F [-], (3, 3, particles), det F > 0
        parameters   youngs_modulus [Pa], poissons_ratio [-], each (particles,)
        returns      tau [Pa], (3, 3, particles), symmetric
        source       Klar et al. 2016, "Drucker-Prager elastoplasticity for sand animation"
        """
        lam, mu = lame_constants(parameters)
        h = hencky_strain(deformation)
        return 2.0 * mu * h + identity_like(h) * (lam * trace(h))
