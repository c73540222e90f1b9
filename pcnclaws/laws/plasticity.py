"""Analytic plasticity: return maps that scale the deviator and the trace of the Hencky strain.

With the trial strain h = 1/2 log(F F^T) and the strain h' that the yield condition allows, the elastic
deformation after plastic flow is F' = exp(h' - h) F: the rotation of F is kept and no singular vectors are
needed, since h and h' commute.
"""

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from pcnclaws.laws.base import Plasticity
from pcnclaws.laws.parameters import lame_constants
from pcnclaws.linalg3 import deviator, exp_symmetric, hencky_strain, matmul, safe_norm, trace
from pcnclaws.tensor_types import Matrices, Parameters, Scalars


class NoPlasticity(Plasticity):
    """A purely elastic material: the trial deformation is the elastic deformation."""

    parameter_names = ()

    def return_map(self, trial: Matrices, parameters: Parameters) -> Matrices:
        return trial


class DruckerPrager(Plasticity):
    """Cohesionless friction: the shear a material bears is proportional to the pressure on it."""

    parameter_names = ("youngs_modulus", "poissons_ratio", "friction_angle")
    kernel = "DruckerPrager"

    def kernel_parameters(self, parameters: Parameters) -> Sequence[Tensor]:
        return (_yield_slope(parameters),)

    def return_map(self, trial: Matrices, parameters: Parameters) -> Matrices:
        """Elastic deformation gradient after frictional flow.

            tr h > 0:   h' = 0 (sand bears no tension)
            otherwise:  dgamma = |dev h| + (3 lambda + 2 mu)/(2 mu) tr(h) alpha,
                        dev h' = dev h (1 - max(dgamma, 0)/|dev h|),  tr h' = tr h
            alpha = sqrt(2/3) 2 sin(phi) / (3 - sin(phi))

        At the tip of the cone (h = 0) and on the yield surface the map has a kink; the derivative there is that
        of one side and finite.

        trial       trial deformation gradient [-], (3, 3, particles), det > 0
        parameters  youngs_modulus [Pa], poissons_ratio [-], friction_angle [deg], each (particles,)
        returns     elastic deformation gradient [-], (3, 3, particles)
        source      Klar et al. 2016, "Drucker-Prager elastoplasticity for sand animation"
        """
        h = hencky_strain(trial)
        volumetric, shear = trace(h), safe_norm(deviator(h))
        excess = shear + _yield_slope(parameters) * volumetric
        flow = isochoric_flow(h, shear, excess.clamp_min(0.0))
        return matmul(exp_symmetric(torch.where(volumetric > 0.0, -h, flow)), trial)


class VonMises(Plasticity):
    """Perfect plasticity with a bound on the shear stress, independent of pressure."""

    parameter_names = ("youngs_modulus", "poissons_ratio", "yield_stress")
    kernel = "VonMises"

    def kernel_parameters(self, parameters: Parameters) -> Sequence[Tensor]:
        return (_yield_strain(parameters),)

    def return_map(self, trial: Matrices, parameters: Parameters) -> Matrices:
        """Elastic deformation gradient after isochoric flow.

            dgamma = |dev h| - tau_Y/(2 mu),   dev h' = dev h (1 - max(dgamma, 0)/|dev h|),   tr h' = tr h

        tau_Y bounds |dev tau| (Frobenius norm): the axial stress at yield is sqrt(3/2) tau_Y in uniaxial stress
        and the shear stress at yield is tau_Y/sqrt(2).

        trial       trial deformation gradient [-], (3, 3, particles), det > 0
        parameters  youngs_modulus [Pa], poissons_ratio [-], yield_stress [Pa], each (particles,)
        returns     elastic deformation gradient [-], (3, 3, particles)
        source      Mises 1913; the return in Hencky strain as in Gao et al. 2017, "An adaptive generalized
                    interpolation material point method for simulating elastoplastic materials"
        """
        h = hencky_strain(trial)
        shear = safe_norm(deviator(h))
        excess = shear - _yield_strain(parameters)
        return matmul(exp_symmetric(isochoric_flow(h, shear, excess.clamp_min(0.0))), trial)


def isochoric_flow(strain: Matrices, shear: Scalars, amount: Scalars) -> Matrices:
    """Change of the Hencky strain h' - h with dev h' = dev h (1 - amount/|dev h|) and tr h' = tr h.

    strain  Hencky strain h of the trial deformation [-], (3, 3, particles)
    shear   |dev h| [-], (particles,)
    amount  plastic flow, 0 to |dev h| [-], (particles,)
    """
    return deviator(strain) * (-amount / torch.where(shear > 0.0, shear, 1.0))


def _yield_slope(parameters: Parameters) -> Scalars:
    """How much shear strain |dev h| a unit of compression tr h bears, (3 lambda + 2 mu)/(2 mu) alpha [-]."""
    lam, mu = lame_constants(parameters)
    sine = torch.sin(parameters["friction_angle"] * (math.pi / 180.0))
    alpha = math.sqrt(2.0 / 3.0) * 2.0 * sine / (3.0 - sine)
    return (3.0 * lam + 2.0 * mu) / (2.0 * mu) * alpha


def _yield_strain(parameters: Parameters) -> Scalars:
    """Shear strain |dev h| at which the yield stress is reached, tau_Y/(2 mu) [-]."""
    _, mu = lame_constants(parameters)
    return parameters["yield_stress"] / (2.0 * mu)
