"""The laws of a material together, and the analytic ones that it is defined by."""

from typing import NamedTuple

from pcnclaws.laws.base import Elasticity, Plasticity
from pcnclaws.laws.internal_variables import InternalVariable, variables_of
from pcnclaws.laws.materials import Material
from pcnclaws.laws.viscosity import Viscosity


class Laws(NamedTuple):
    """The laws of a material. plasticity and viscosity are None where it has none: nothing is evaluated then."""

    elasticity: Elasticity
    plasticity: Plasticity | None
    viscosity: Viscosity | None = None

    @property
    def internal_variables(self) -> tuple[InternalVariable, ...]:
        """Those of the plastic law, then what else the elastic one reads."""
        return variables_of((self.plasticity, self.elasticity))


def analytic_laws(material: Material) -> Laws:
    """The laws that the material is defined by."""
    plastic, viscous = material.plasticity, material.viscosity
    return Laws(material.elasticity(), plastic() if plastic else None, viscous() if viscous else None)
