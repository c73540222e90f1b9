"""The objects that laws are tested with and never trained on: the paper's unseen ones and its estimation truths.

Materials that the paper does not have borrow their parameters from those it has.
"""

from collections.abc import Mapping
from typing import NamedTuple


class ReferenceObject(NamedTuple):
    """An object of the paper, or of a material that the paper does not have.

    parameters  physical parameters by name
    paper_mse   the paper's error of its multi-scene law on this unseen object [m^2], None where it gives none
    """

    name: str
    material: str
    parameters: Mapping[str, float]
    paper_mse: float | None


def _elastic(name: str, youngs_modulus: float, poissons_ratio: float, paper_mse: float | None) -> ReferenceObject:
    parameters = {"youngs_modulus": youngs_modulus, "poissons_ratio": poissons_ratio}
    return ReferenceObject(name, "elasticity", parameters, paper_mse)


def _plasticine(
    name: str, youngs_modulus: float, poissons_ratio: float, yield_stress: float, paper_mse: float | None
) -> ReferenceObject:
    parameters = {"youngs_modulus": youngs_modulus, "poissons_ratio": poissons_ratio, "yield_stress": yield_stress}
    return ReferenceObject(name, "plasticine", parameters, paper_mse)


def _sand(
    name: str, youngs_modulus: float, poissons_ratio: float, friction_angle: float, paper_mse: float | None
) -> ReferenceObject:
    parameters = {"youngs_modulus": youngs_modulus, "poissons_ratio": poissons_ratio, "friction_angle": friction_angle}
    return ReferenceObject(name, "sand", parameters, paper_mse)


def _borrowed(material: str, owner: str) -> list[ReferenceObject]:
    """The objects of another material, which the paper does not have."""
    return [thing._replace(material=material, paper_mse=None) for thing in _PAPER_OBJECTS if thing.material == owner]


# All six unseen objects of the paper are among its nine estimation truths.
_PAPER_OBJECTS = (
    _elastic("test-E1.8e5-nu0.13", 1.8e5, 0.13, 4.3e-4),
    _elastic("test-E1.4e5-nu0.18", 1.4e5, 0.18, 3.9e-4),
    _elastic("test-E2.0e5-nu0.15", 2.0e5, 0.15, None),
    _plasticine("test-E5.3e5-nu0.31-tauY5.1e3", 5.3e5, 0.31, 5.1e3, 3.4e-4),
    _plasticine("test-E4.2e5-nu0.33-tauY5.7e3", 4.2e5, 0.33, 5.7e3, 3.1e-4),
    _plasticine("test-E4.7e5-nu0.36-tauY4.2e3", 4.7e5, 0.36, 4.2e3, None),
    _sand("test-E3.7e5-nu0.18-phi30", 3.7e5, 0.18, 30.0, 2.0e-4),
    _sand("test-E4.2e5-nu0.23-phi26", 4.2e5, 0.23, 26.0, 2.6e-4),
    _sand("test-E3.3e5-nu0.20-phi22", 3.3e5, 0.20, 22.0, None),
)
REFERENCE_OBJECTS = (*_PAPER_OBJECTS, *_borrowed("neo_hookean", "elasticity"), *_borrowed("tresca", "plasticine"))
# Training data keeps this relative distance from every reference object in at least one parameter.
NEIGHBOURHOOD = 0.03


def reference_objects(material: str) -> list[ReferenceObject]:
    """The test-only objects of a material."""
    return [thing for thing in REFERENCE_OBJECTS if thing.material == material]


def is_near_reference(parameters: Mapping[str, float], material: str) -> bool:
    """Whether all parameters lie within NEIGHBOURHOOD of those of one reference object."""
    return any(
        all(abs(parameters[name] - value) <= NEIGHBOURHOOD * value for name, value in thing.parameters.items())
        for thing in reference_objects(material)
    )
