"""The laws of a material together, and the analytic ones that it is defined by."""

from typing import NamedTuple

from pcnclaws.laws.base import Elasticity, Plasticity
from pcnclaws.laws.materials import Material


class Laws(NamedTuple):
    """The two laws of a material. plasticity is None for a purely elastic one: nothing is evaluated then."""

    elasticity: Elasticity
    plasticity: Plasticity | None


def analytic_laws(material: Material) -> Laws:
    """The laws that the material is defined by."""
    return Laws(material.elasticity(), material.plasticity() if material.plasticity else None)
