"""The materials: which laws and parameters each one has, and the ranges that data is made for.

The only table from names to classes of laws; whatever a file names is looked up here and nowhere else.
"""

from collections.abc import Mapping
from typing import NamedTuple

from pcnclaws.errors import unknown_name
from pcnclaws.laws.base import Elasticity, Plasticity
from pcnclaws.laws.elasticity import FixedCorotated, NeoHookean, StVKHencky
from pcnclaws.laws.plasticity import DruckerPrager, Tresca, VonMises


class Laws(NamedTuple):
    """The two laws of a material. plasticity is None for a purely elastic one: nothing is evaluated then."""

    elasticity: Elasticity
    plasticity: Plasticity | None


class Material(NamedTuple):
    """A material, its analytic laws and the ranges of its physical parameters in training data."""

    name: str
    elasticity: type[Elasticity]
    plasticity: type[Plasticity] | None
    ranges: Mapping[str, tuple[float, float]]

    @property
    def parameter_names(self) -> tuple[str, ...]:
        return tuple(self.ranges)

    @property
    def defaults(self) -> dict[str, float]:
        """The middle of the ranges."""
        return {name: 0.5 * (low + high) for name, (low, high) in self.ranges.items()}


_ELASTICITY = {"youngs_modulus": (5e4, 3e5), "poissons_ratio": (0.05, 0.40)}
_PLASTICINE = {"youngs_modulus": (2e5, 7e5), "poissons_ratio": (0.15, 0.42), "yield_stress": (2e3, 8e3)}
_SAND = {"youngs_modulus": (2e5, 6e5), "poissons_ratio": (0.10, 0.40), "friction_angle": (18.0, 38.0)}

MATERIALS = {
    material.name: material
    for material in (
        Material("elasticity", FixedCorotated, None, _ELASTICITY),
        Material("plasticine", StVKHencky, VonMises, _PLASTICINE),
        Material("sand", StVKHencky, DruckerPrager, _SAND),
        # in neither family of the neural laws: what learning does where the structure does not know the answer
        Material("neo_hookean", NeoHookean, None, _ELASTICITY),
        Material("tresca", StVKHencky, Tresca, _PLASTICINE),
    )
}


def material_named(name: str, option: str = "material") -> Material:
    """The material of that name; UserError with the nearest known name otherwise."""
    if name not in MATERIALS:
        raise unknown_name(option, name, MATERIALS)
    return MATERIALS[name]


def analytic_laws(material: Material) -> Laws:
    """The laws that the material is defined by."""
    return Laws(material.elasticity(), material.plasticity() if material.plasticity else None)
