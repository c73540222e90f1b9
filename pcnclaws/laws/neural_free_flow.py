"""Neural laws whose plastic flow need not go straight back to the yield surface, `model=pcnclaws_free_flow`.

The radial return of the default variant is exact for von Mises and Drucker-Prager, whose surfaces are round. A surface
with corners or flat sides, such as Tresca's, flows along its own normal: stress wanders along the surface.
"""

import torch
from torch import Tensor

from pcnclaws.laws.neural_default import PlasticNet
from pcnclaws.linalg3 import determinant, deviator, matmul, safe_norm
from pcnclaws.tensor_types import Matrices, Scalars

# The network's output that turns the flow is multiplied by this: 1 is then a flow at 45 degrees from the radius.
TURN = 4.0 * 6.0**0.5


class FreeFlowPlasticNet(PlasticNet):
    """The return of PlasticNet, turned around the axis of pressure by an angle that the network finds.

        dev h' = k w/|w|,   w = k n - (|dev h| - k) t m,   n = dev h/|dev h|,   m = dev(n^2) - (n^2 : n) n

    k is PlasticNet's limit of |dev h|, n the radius and m the direction around the axis with the same principal axes, 0
    where two principal strains are equal, so that the law stays isotropic. t = 0 is the radial return. |dev h'| = k
    whatever t is: as before, Hencky energy can only be released.
    """

    kernel = "FreeFlowPlasticNet"
    outputs = 4

    def _flow(self, dev: Matrices, shear: Scalars, limit: Scalars, f: Tensor) -> Matrices:
        """What a particle that yields adds to dev h: it goes to the surface beside its radius."""
        yields = shear > limit
        n = dev / torch.where(yields, shear, 1.0)
        around = deviator(matmul(n, n)) - 3.0 * determinant(n) * n
        w = limit * n - (shear - limit) * TURN * f[3] * around
        length = safe_norm(w)
        return limit * w / torch.where(length > 0.0, length, 1.0) - dev
