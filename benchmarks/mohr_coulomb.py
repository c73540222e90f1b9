"""Mohr-Coulomb friction: a plastic law of another form than those that ship."""

import math
from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from pcnclaws.laws.base import Plasticity, Values
from pcnclaws.laws.moduli import lame_constants
from pcnclaws.laws.operations import deviator, maximum, minimum, trace, where
from pcnclaws.laws.parameters import FRICTION_ANGLE, POISSONS_RATIO, YOUNGS_MODULUS
from pcnclaws.tensors.tensor_types import Parameters


class MohrCoulomb(Plasticity):
    """Friction without cohesion or dilation: (tau_1 - tau_3) + (tau_1 + tau_3) sin(phi) <= 0, returned to radially.

    tau_1, tau_3  the largest and the smallest principal stress, positive in tension
    source        Coulomb 1776; the form in principal stresses as in de Souza Neto et al. 2008, "Computational methods
                  for plasticity", section 6.4
    """

    physical_parameters = (YOUNGS_MODULUS, POISSONS_RATIO, FRICTION_ANGLE)

    def coefficients(self, parameters: Parameters) -> Mapping[str, Tensor]:
        """sine: sin(phi). bulk: the mean stress of a unit of tr h over 2 mu."""
        lam, mu = lame_constants(parameters)
        sine = torch.sin(parameters["friction_angle"] * (math.pi / 180.0))
        return {"sine": sine, "bulk": (lam + 2.0 / 3.0 * mu) / (2.0 * mu)}

    def strain_after_flow(self, h: Values, p: Any) -> Values:
        dev, volumetric = deviator(h), trace(h)
        high, low = maximum(maximum(dev[0], dev[1]), dev[2]), minimum(minimum(dev[0], dev[1]), dev[2])
        shear, borne = high - low + (high + low) * p.sine, -2.0 * p.sine * p.bulk * volumetric
        flows = shear > borne
        share = where(flows, 1.0 - borne / where(flows, shear, 1.0), 0.0)
        return [where(volumetric > 0.0, 0.0, strain - share * d) for strain, d in zip(h, dev, strict=True)]
