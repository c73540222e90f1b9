"""Materials: each is one object with its laws, the ranges of its parameters in training data and its reference objects.

Nothing here loads PyTorch: the classes of the built-in materials are imported when somebody asks for them.
"""

import importlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pcnclaws.errors import unknown_name
from pcnclaws.laws.parameters import Parameter

OTHER_COLOUR = (0.62, 0.66, 0.70)


@dataclass(frozen=True)
class ReferenceObject:
    """An object that laws are tested with and never trained on.

    parameters  physical parameters by name
    paper_mse   the paper's error of its multi-scene law on this unseen object [m^2], None where it gives none
    """

    name: str
    parameters: Mapping[str, float]
    paper_mse: float | None = None


@dataclass(frozen=True)
class Kind:
    """One of the kinds of body that a material holds, and what data of it is drawn from.

    ranges  of the physical parameters that matter to it
    fixed   values of all others
    """

    ranges: Mapping[str, tuple[float, float]]
    fixed: Mapping[str, float]


@dataclass(frozen=True)
class Material:
    """A material: its analytic laws and the ranges of its physical parameters in training data.

    elastic  class of its elastic law, or where it is, as 'module:class'
    plastic  the same of its plastic law, None for a purely elastic material: nothing is evaluated then
    ranges   of each physical parameter of the laws; their middle is the default
    objects  that laws are tested with
    colour   of its particles in pictures, RGB from 0 to 1
    viscous  class of its viscous law, or where it is; None: no stress depends on the velocity gradient
    kinds    of body that it holds: training scenes are of one after the other; none: they are drawn from `ranges`
    density  [kg/m^3], where neither settings nor particles say another one
    """

    name: str
    elastic: Any
    plastic: Any
    ranges: Mapping[str, tuple[float, float]]
    objects: tuple[ReferenceObject, ...] = ()
    colour: tuple[float, float, float] = OTHER_COLOUR
    viscous: Any = None
    kinds: tuple[Kind, ...] = ()
    density: float | int = 1000.0

    @property
    def elasticity(self) -> Any:
        """The class of the elastic law."""
        return resolved(self.elastic)

    @property
    def plasticity(self) -> Any:
        """The class of the plastic law, None for a purely elastic material."""
        return resolved(self.plastic)

    @property
    def viscosity(self) -> Any:
        """The class of the viscous law, None without one."""
        return resolved(self.viscous)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        return tuple(self.ranges)

    @property
    def defaults(self) -> dict[str, float]:
        """The middle of the ranges."""
        return {name: 0.5 * (low + high) for name, (low, high) in self.ranges.items()}

    @property
    def physical_parameters(self) -> tuple[Parameter, ...]:
        """Those of its laws, each once."""
        laws = [law for law in (self.elasticity, self.plasticity, self.viscosity) if law is not None]
        return tuple(dict.fromkeys(parameter for law in laws for parameter in law.physical_parameters))


OWN_MATERIAL = "one of your own once pc.register, or plugins=[module] of a command, has made it known"


def material_named(name: str, option: str = "material") -> Material:
    """The material of that name; UserError with the nearest known name otherwise."""
    if name not in MATERIALS:
        raise unknown_name(option, name, MATERIALS, OWN_MATERIAL)
    return MATERIALS[name]


def resolved(law: Any) -> Any:
    """The class of a law, imported where only its place, 'module:class', is known."""
    if not isinstance(law, str):
        return law
    module, _, name = law.partition(":")
    return getattr(importlib.import_module(module), name)


def _object(name: str, paper_mse: float | None = None, **parameters: float) -> ReferenceObject:
    return ReferenceObject(f"test-{name}", parameters, paper_mse)


# The paper's unseen objects and its estimation truths: all six of the former are among the nine of the latter.
_ELASTIC_OBJECTS = (
    _object("E1.8e5-nu0.13", 4.3e-4, youngs_modulus=1.8e5, poissons_ratio=0.13),
    _object("E1.4e5-nu0.18", 3.9e-4, youngs_modulus=1.4e5, poissons_ratio=0.18),
    _object("E2.0e5-nu0.15", youngs_modulus=2.0e5, poissons_ratio=0.15),
)
_PLASTICINE_OBJECTS = (
    _object("E5.3e5-nu0.31-tauY5.1e3", 3.4e-4, youngs_modulus=5.3e5, poissons_ratio=0.31, yield_stress=5.1e3),
    _object("E4.2e5-nu0.33-tauY5.7e3", 3.1e-4, youngs_modulus=4.2e5, poissons_ratio=0.33, yield_stress=5.7e3),
    _object("E4.7e5-nu0.36-tauY4.2e3", youngs_modulus=4.7e5, poissons_ratio=0.36, yield_stress=4.2e3),
)
_SAND_OBJECTS = (
    _object("E3.7e5-nu0.18-phi30", 2.0e-4, youngs_modulus=3.7e5, poissons_ratio=0.18, friction_angle=30.0),
    _object("E4.2e5-nu0.23-phi26", 2.6e-4, youngs_modulus=4.2e5, poissons_ratio=0.23, friction_angle=26.0),
    _object("E3.3e5-nu0.20-phi22", youngs_modulus=3.3e5, poissons_ratio=0.20, friction_angle=22.0),
)


def _borrowed(objects: tuple[ReferenceObject, ...]) -> tuple[ReferenceObject, ...]:
    """The objects of another material, for one that the paper does not have."""
    return tuple(ReferenceObject(thing.name, thing.parameters) for thing in objects)


_ELASTICITY = {"youngs_modulus": (5e4, 3e5), "poissons_ratio": (0.05, 0.40)}
_PLASTICINE = {"youngs_modulus": (2e5, 7e5), "poissons_ratio": (0.15, 0.42), "yield_stress": (2e3, 8e3)}
_SAND = {"youngs_modulus": (2e5, 6e5), "poissons_ratio": (0.10, 0.40), "friction_angle": (18.0, 38.0)}
# A kind's share of the unified material is its own parameter; elasticity has what the others leave.
_SHARES = ("plasticine_share", "sand_share")
_OF_KINDS = {"": _ELASTICITY, "plasticine_share": _PLASTICINE, "sand_share": _SAND}


def _united() -> dict[str, tuple[float, float]]:
    """The ranges of all kinds together, and those of their shares."""
    names = dict.fromkeys(name for ranges in _OF_KINDS.values() for name in ranges)
    spans = {name: [ranges[name] for ranges in _OF_KINDS.values() if name in ranges] for name in names}
    united = {name: (min(low for low, _ in some), max(high for _, high in some)) for name, some in spans.items()}
    return united | dict.fromkeys(_SHARES, (0.0, 1.0))


_UNIFIED = _united()


def _beside(share: str, own: Mapping[str, Any]) -> dict[str, float]:
    """What a body of one kind has beside its own parameters: its share, and the middle of what it does not read."""
    shares = {name: float(name == share) for name in _SHARES}
    unread = {name: 0.5 * (low + high) for name, (low, high) in _UNIFIED.items() if name not in own}
    return unread | shares


def _in_one(share: str, objects: tuple[ReferenceObject, ...]) -> tuple[ReferenceObject, ...]:
    """The objects of a kind as bodies of the unified material."""
    return tuple(
        ReferenceObject(thing.name, {**thing.parameters, **_beside(share, thing.parameters)}) for thing in objects
    )


_UNIFIED_OBJECTS = (
    *_in_one("", _ELASTIC_OBJECTS),
    *_in_one("plasticine_share", _PLASTICINE_OBJECTS),
    *_in_one("sand_share", _SAND_OBJECTS),
)
_KINDS = tuple(Kind(ranges, _beside(share, ranges)) for share, ranges in _OF_KINDS.items())
_ELASTIC, _PLASTIC = "pcnclaws.laws.elasticity", "pcnclaws.laws.plasticity"
_HENCKY = f"{_ELASTIC}:StVKHencky"

MATERIALS: dict[str, Material] = {
    material.name: material
    for material in (
        Material("elasticity", f"{_ELASTIC}:FixedCorotated", None, _ELASTICITY, _ELASTIC_OBJECTS, (0.45, 0.66, 0.88)),
        Material("plasticine", _HENCKY, f"{_PLASTIC}:VonMises", _PLASTICINE, _PLASTICINE_OBJECTS, (0.86, 0.50, 0.42)),
        Material("sand", _HENCKY, f"{_PLASTIC}:DruckerPrager", _SAND, _SAND_OBJECTS, (0.90, 0.74, 0.45)),
        # in neither family of the neural laws: what learning does where the structure does not know the answer
        Material("neo_hookean", f"{_ELASTIC}:NeoHookean", None, _ELASTICITY, _borrowed(_ELASTIC_OBJECTS)),
        Material("tresca", _HENCKY, f"{_PLASTIC}:Tresca", _PLASTICINE, _borrowed(_PLASTICINE_OBJECTS)),
        # the three of the paper in one, and what lies between them
        Material(
            "unified",
            "pcnclaws.laws.unified:UnifiedElasticity",
            "pcnclaws.laws.unified:UnifiedPlasticity",
            _UNIFIED,
            _UNIFIED_OBJECTS,
            kinds=_KINDS,
        ),
    )
}
