"""A material of one's own for the commands: rubber that locks, with a law and a parameter that are stated here alone.

From this folder, or any other that Python finds the module from:

    python -m pcnclaws.simulate plugins=[locking_rubber] material=locking_rubber parameters.locking=20 output=rubber.h5
    python -m pcnclaws.generate plugins=[locking_rubber] material=locking_rubber output=data
    python -m pcnclaws.train plugins=[locking_rubber] material=locking_rubber data.folder=data output=run

The first leaves rubber.png, the others pictures of the data and of the learned law. `law=run` simulates with that law.
"""

from collections.abc import Mapping
from typing import Any

from torch import Tensor

import pcnclaws as pc
from pcnclaws.laws.base import Values
from pcnclaws.laws.moduli import lame_constants
from pcnclaws.laws.operations import deviator, trace
from pcnclaws.laws.parameters import POISSONS_RATIO, YOUNGS_MODULUS
from pcnclaws.tensors.tensor_types import Parameters

LOCKING = pc.Parameter("locking", "k", "-", lower_included=True, logarithmic=True, search=(1.0, 100.0))


class LockingRubber(pc.Elasticity):
    """Hencky elasticity whose stiffness in shear grows with strain.

    energy  mu (1 + k |dev h|^2 / 2) |dev h|^2 + K/2 tr(h)^2, h the Hencky strains
    """

    physical_parameters = (YOUNGS_MODULUS, POISSONS_RATIO, LOCKING)

    def coefficients(self, parameters: Parameters) -> Mapping[str, Tensor]:
        lam, mu = lame_constants(parameters)
        return {"mu": mu, "bulk": lam + 2.0 / 3.0 * mu, "locking": parameters["locking"]}

    def principal_energy(self, h: Values, p: Any) -> Any:
        shear = sum(d * d for d in deviator(h))
        volumetric = trace(h)
        return p.mu * (1.0 + 0.5 * p.locking * shear) * shear + 0.5 * p.bulk * volumetric * volumetric


pc.register(
    pc.Material(
        "locking_rubber",
        LockingRubber,
        None,
        {"youngs_modulus": (5e4, 2e5), "poissons_ratio": (0.2, 0.4), "locking": (2.0, 30.0)},
        colour=(0.35, 0.35, 0.42),
    )
)
