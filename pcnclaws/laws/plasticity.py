"""Analytic plasticity: return maps that shrink the deviator and the trace of the Hencky strain.

With the trial strain h = 1/2 log(F F^T) and the strain h' that the yield condition allows, the elastic deformation
after plastic flow is F' = exp(h' - h) F: h and h' commute, and the rotation of F is kept.
"""

import math
from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from pcnclaws.laws.base import Plasticity, Values
from pcnclaws.laws.moduli import lame_constants
from pcnclaws.laws.operations import deviator, maximum, minimum, norm, trace, where
from pcnclaws.laws.parameters import FRICTION_ANGLE, POISSONS_RATIO, YIELD_STRESS, YOUNGS_MODULUS
from pcnclaws.tensors.tensor_types import Parameters, Scalars


class DruckerPrager(Plasticity):
    """Cohesionless friction: the shear a material bears is proportional to the pressure on it.

        tr h > 0:   h' = 0 (sand bears no tension)
        otherwise:  dgamma = |dev h| + (3 lambda + 2 mu)/(2 mu) tr(h) alpha,
                    dev h' = dev h (1 - max(dgamma, 0)/|dev h|),  tr h' = tr h
        alpha = sqrt(2/3) 2 sin(phi) / (3 - sin(phi))

    At the tip of the cone (h = 0) and on the yield surface the map has a kink; the derivative there is that of one side
    and finite.

    source  Klar et al. 2016, "Drucker-Prager elastoplasticity for sand animation"
    """

    physical_parameters = (YOUNGS_MODULUS, POISSONS_RATIO, FRICTION_ANGLE)

    def coefficients(self, parameters: Parameters) -> Mapping[str, Tensor]:
        """slope: the shear strain |dev h| that a unit of compression tr h bears, (3 lambda + 2 mu)/(2 mu) alpha [-]."""
        lam, mu = lame_constants(parameters)
        sine = torch.sin(parameters["friction_angle"] * (math.pi / 180.0))
        alpha = math.sqrt(2.0 / 3.0) * 2.0 * sine / (3.0 - sine)
        return {"slope": (3.0 * lam + 2.0 * mu) / (2.0 * mu) * alpha}

    def strain_after_flow(self, h: Values, p: Any) -> Values:
        dev, volumetric = deviator(h), trace(h)
        shear = norm(dev)
        flow = _radial_flow(dev, shear, shear + p.slope * volumetric)
        return [where(volumetric > 0.0, 0.0, strain - change) for strain, change in zip(h, flow, strict=True)]


class VonMises(Plasticity):
    """Perfect plasticity with a bound on the shear stress, independent of pressure.

        dgamma = |dev h| - tau_Y/(2 mu),   dev h' = dev h (1 - max(dgamma, 0)/|dev h|),   tr h' = tr h

    tau_Y bounds |dev tau| (Frobenius norm): the axial stress at yield is sqrt(3/2) tau_Y in uniaxial stress and the
    shear stress at yield is tau_Y/sqrt(2).

    source  Mises 1913; the return in Hencky strain as in Gao et al. 2017, "An adaptive generalized interpolation
            material point method for simulating elastoplastic materials"
    """

    physical_parameters = (YOUNGS_MODULUS, POISSONS_RATIO, YIELD_STRESS)

    def coefficients(self, parameters: Parameters) -> Mapping[str, Tensor]:
        return {"limit": strain_at_yield(parameters)}

    def strain_after_flow(self, h: Values, p: Any) -> Values:
        dev = deviator(h)
        shear = norm(dev)
        flow = _radial_flow(dev, shear, shear - p.limit)
        return [strain - change for strain, change in zip(h, flow, strict=True)]


class Tresca(Plasticity):
    """Perfect plasticity with a bound on the largest shear stress: a hexagon where von Mises has a circle.

        e1 - e3 <= L = sqrt(2) tau_Y/(2 mu)   with the principal values e1 >= e2 >= e3 of dev h
        e2' = min(max(e2, -L/3), L/3),   e1' = (L - e2')/2,   e3' = -(L + e2')/2 where e1 - e3 > L,   tr h' = tr h

    The nearest admissible strain: on a face of the hexagon e2' = e2; at its corners e2' meets e1' or e3'. As a stress
    the bound is tau_1 - tau_3 <= sqrt(2) tau_Y: in pure shear it agrees with von Mises, |dev tau| = tau_Y, and the
    shear stress at yield is tau_Y/sqrt(2); in uniaxial stress it yields at sqrt(2) tau_Y, von Mises at sqrt(3/2) tau_Y.

    source  Tresca 1864; closest-point return to the planes and corners in principal stresses as in de Souza Neto et al.
            2008, "Computational methods for plasticity", section 8.1
    """

    physical_parameters = (YOUNGS_MODULUS, POISSONS_RATIO, YIELD_STRESS)

    def coefficients(self, parameters: Parameters) -> Mapping[str, Tensor]:
        """limit: the largest difference of two principal strains [-]."""
        return {"limit": math.sqrt(2.0) * strain_at_yield(parameters)}

    def strain_after_flow(self, h: Values, p: Any) -> Values:
        """Every value is held between the lowest and the highest that the middle one allows: no order is asked for."""
        dev = deviator(h)
        third, larger, smaller = p.limit / 3.0, maximum(dev[0], dev[1]), minimum(dev[0], dev[1])
        middle = _held(maximum(smaller, minimum(larger, dev[2])), -third, third)
        highest, lowest = 0.5 * (p.limit - middle), -(0.5 * (p.limit + middle))
        return [strain + (_held(value, lowest, highest) - value) for strain, value in zip(h, dev, strict=True)]


def strain_at_yield(parameters: Parameters) -> Scalars:
    """Shear strain |dev h| at which the yield stress is reached, tau_Y/(2 mu) [-]."""
    _, mu = lame_constants(parameters)
    return parameters["yield_stress"] / (2.0 * mu)


def _radial_flow(dev: Values, shear: Any, excess: Any) -> Values:
    """What shrinks the deviator by so much of its norm, where that is positive: excess dev h/|dev h|."""
    share = where(shear > 0.0, where(excess > 0.0, excess, 0.0) / where(shear > 0.0, shear, 1.0), 0.0)
    return [value * share for value in dev]


def _held(x: Any, low: Any, high: Any) -> Any:
    return maximum(minimum(x, high), low)
