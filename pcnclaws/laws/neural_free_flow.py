"""Neural laws whose plastic flow need not go straight back to the yield surface, `model=pcnclaws_free_flow`.

The radial return of the default variant is exact for von Mises and Drucker-Prager, whose surfaces are round. A surface
with corners or flat sides, such as Tresca's, flows along its own normal: stress wanders along the surface.
"""

from typing import Any

from pcnclaws.laws.base import Values
from pcnclaws.laws.neural_default import PlasticNet
from pcnclaws.laws.operations import norm, sum_of_squares, where

# The network's output that turns the flow is multiplied by this: 1 is then a flow at 45 degrees from the radius.
TURN = 4.0 * 6.0**0.5


class FreeFlowPlasticNet(PlasticNet):
    """The return of PlasticNet, turned around the axis of pressure by an angle that the network finds.

        dev h' = k w/|w|,   w = k n - (|dev h| - k) t m,   n = dev h/|dev h|,   m = dev(n^2) - (n^2 : n) n

    k is PlasticNet's limit of |dev h|, n the radius and m the direction around the axis with the same principal axes, 0
    where two principal strains are equal, so that the law stays isotropic. t = 0 is the radial return. |dev h'| = k
    whatever t is: as before, Hencky energy can only be released.
    """

    outputs = 4

    def _flow(self, dev: Values, shear: Any, limit: Any, f: Values) -> Values:
        """What a particle that yields adds to dev h: it goes to the surface beside its radius."""
        n = [d / shear for d in dev]
        third, lode = sum_of_squares(n) / 3.0, 3.0 * (n[0] * n[1] * n[2])
        turn = (shear - limit) * TURN * f[3]
        w = [limit * k - turn * (k * k - third - lode * k) for k in n]
        length = norm(w)
        share = limit / where(length > 0.0, length, 1.0)
        return [share * k - d for k, d in zip(w, dev, strict=True)]
