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
from pcnclaws.linalg3 import (
    determinant,
    deviator,
    hencky_strain,
    identity_like,
    matmul,
    safe_norm,
    stretched,
    trace,
)
from pcnclaws.tensor_types import Matrices, Parameters, Scalars


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
        return stretched(torch.where(volumetric > 0.0, -h, flow), trial)


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
        return stretched(isochoric_flow(h, shear, excess.clamp_min(0.0)), trial)


class Tresca(Plasticity):
    """Perfect plasticity with a bound on the largest shear stress: a hexagon where von Mises has a circle."""

    parameter_names = ("youngs_modulus", "poissons_ratio", "yield_stress")
    kernel = "Tresca"

    def kernel_parameters(self, parameters: Parameters) -> Sequence[Tensor]:
        return (_tresca_limit(parameters),)

    def return_map(self, trial: Matrices, parameters: Parameters) -> Matrices:
        """Elastic deformation gradient after associated flow: the nearest admissible strain.

            e1 - e3 <= L = sqrt(2) tau_Y/(2 mu)   with the principal values e1 >= e2 >= e3 of dev h
            e2' = min(max(e2, -L/3), L/3),   e1' = (L - e2')/2,   e3' = -(L + e2')/2 where e1 - e3 > L,   tr h' = tr h

        On a face of the hexagon e2' = e2; at its corners e2' meets e1' or e3'. As a stress the bound is
        tau_1 - tau_3 <= sqrt(2) tau_Y: in pure shear it agrees with von Mises, |dev tau| = tau_Y, and the shear stress
        at yield is tau_Y/sqrt(2); in uniaxial stress it yields at sqrt(2) tau_Y, von Mises at sqrt(3/2) tau_Y.

        trial       trial deformation gradient [-], (3, 3, particles), det > 0
        parameters  youngs_modulus [Pa], poissons_ratio [-], yield_stress [Pa], each (particles,)
        returns     elastic deformation gradient [-], (3, 3, particles)
        source      Tresca 1864; closest-point return to the planes and corners in principal stresses as in de Souza
                    Neto et al. 2008, "Computational methods for plasticity", section 8.1
        """
        h = hencky_strain(trial)
        flow = _flow_to_hexagon(deviator(h).double(), _tresca_limit(parameters).double())
        return stretched(flow.to(trial.dtype), trial)


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


def _tresca_limit(parameters: Parameters) -> Scalars:
    """Largest difference of two principal Hencky strains, sqrt(2) tau_Y/(2 mu) [-]."""
    return math.sqrt(2.0) * _yield_strain(parameters)


def _flow_to_hexagon(dev: Matrices, limit: Scalars) -> Matrices:
    """Change of the Hencky deviator to the nearest one whose principal values differ by at most `limit`.

    Written with the axis of the principal value x that lies apart from the two others, -x/2 +- d/2:
        dev = x M + B,   M = (3 P - I)/2,   P the projector on that axis,   d = sqrt(2) |B|
    so that the nearest one is x' M + d'/d B. x is never close to the others, and where those meet, their directions
    do not matter: every derivative is finite.
    """
    x, projector = _value_apart(dev)
    axial = 1.5 * projector - 0.5 * identity_like(dev)
    rest = dev - x * axial
    size, gap = x.abs(), math.sqrt(2.0) * safe_norm(rest)
    # the middle value is -+(|x| - d)/2; beyond limit/3 the nearest point is a corner, where d' = 0
    middle = torch.where(size - gap < limit / 1.5, 0.5 * (size - gap), limit / 3.0)
    gap_after = 0.5 * (limit - 3.0 * middle)
    change = torch.sign(x) * (0.5 * (limit + middle)) - x
    flow = change * axial + (gap_after / torch.where(gap > 0.0, gap, 1.0) - 1.0) * rest
    # times 0 and not 0 itself, so that what is not a number stays so
    return torch.where(1.5 * size + 0.5 * gap > limit, flow, 0.0 * dev)


def _value_apart(dev: Matrices) -> tuple[Scalars, Matrices]:
    """The principal value of a deviator that lies apart from the two others, and the projector on its axis.

    x is the root of x^3 = q x + r of largest size, q = tr(A^2)/2, r = det A, which is simple: 2 q <= 3 x^2 - q.
    """
    # powers of what is small vanish: beside a largest entry of about 1 none does; a power of two changes no digit
    largest = dev.detach().abs().amax((0, 1))
    scale = torch.ldexp(torch.ones_like(largest), torch.frexp(largest).exponent)
    dev = dev / scale
    squared = matmul(dev, dev)
    q, r = 0.5 * trace(squared), determinant(dev)
    still = q == 0.0
    q, r = torch.where(still, 1.0, q), torch.where(still, 0.0, r)
    root = _root_of_largest_size(q.detach(), r.detach())
    # a Newton step from a root changes nothing but gives its derivative
    x = root - (root.pow(3) - q * root - r) / (3.0 * root.square() - q)
    projector = (squared + x * dev + identity_like(dev) * (x.square() - q)) / (3.0 * x.square() - q)
    return torch.where(still, 0.0, scale * x), projector


def _root_of_largest_size(q: Scalars, r: Scalars) -> Scalars:
    """The root of x^3 = q x + r of largest size, where all three are real (Viete's trigonometric formula)."""
    cosine = (1.5 * math.sqrt(3.0) * r.abs() / q.pow(1.5)).clamp_max(1.0)
    return torch.where(r < 0.0, -2.0, 2.0) * (q / 3.0).sqrt() * torch.cos(torch.acos(cosine) / 3.0)
