"""What is known by name: materials and networks, ours and those that a program or a plugin registers.

The only tables from names to classes of laws; whatever a file names is looked up here and nowhere else. Nothing here
loads PyTorch: the classes of the built-in ones are imported when somebody asks for them.
"""

import math
from dataclasses import dataclass
from typing import Any

from pcnclaws.errors import UserError, unknown_name
from pcnclaws.laws.materials import MATERIALS, Material, resolved
from pcnclaws.laws.parameters import PARAMETERS


@dataclass(frozen=True)
class Network:
    """A kind of neural laws.

    elastic  class of the elastic law, made with a material and a width, or where it is, as 'module:class'
    plastic  the same of the plastic law, for materials that have one
    width    of the hidden layers, where nobody says another one
    """

    name: str
    elastic: Any
    plastic: Any
    width: int = 64

    @property
    def elasticity(self) -> Any:
        """The class of the elastic law."""
        return resolved(self.elastic)

    @property
    def plasticity(self) -> Any:
        """The class of the plastic law."""
        return resolved(self.plastic)


# What scenes, laws and loops call something else.
RESERVED = (
    *("body", "law", "velocity", "spin", "settings", "colliders", "loads", "name", "start_time"),
    *("internal", "dt", "time_step", "steps", "every", "dtype", "device"),
)

NETWORKS: dict[str, Network] = {
    network.name: network
    for network in (
        Network("pcnclaws", "pcnclaws.laws.neural_default:ElasticNet", "pcnclaws.laws.neural_default:PlasticNet"),
        Network("pcnclaws_energy", "pcnclaws.laws.neural_energy:EnergyNet", "pcnclaws.laws.neural_default:PlasticNet"),
        Network(
            "pcnclaws_stretches",
            "pcnclaws.laws.stretch_energy:StretchEnergyNet",
            "pcnclaws.laws.neural_default:PlasticNet",
            width=12,
        ),
        Network(
            "pcnclaws_free_flow",
            "pcnclaws.laws.neural_default:ElasticNet",
            "pcnclaws.laws.neural_free_flow:FreeFlowPlasticNet",
        ),
        Network(
            "pcnclaws_convex",
            "pcnclaws.laws.neural_energy:EnergyNet",
            "pcnclaws.laws.neural_convex:ConvexPlasticNet",
        ),
        Network(
            "pcnclaws_unified",
            "pcnclaws.laws.neural_unified:UnifiedElasticNet",
            "pcnclaws.laws.neural_unified:UnifiedPlasticNet",
        ),
        Network(
            "pcnclaws_no_prior",
            "pcnclaws.laws.neural_no_prior:NoPriorElasticNet",
            "pcnclaws.laws.neural_no_prior:NoPriorPlasticNet",
        ),
        Network(
            "pcnclaws_paper",
            "pcnclaws.laws.neural_paper:PaperElasticNet",
            "pcnclaws.laws.neural_paper:PaperPlasticNet",
        ),
    )
}


# What ships, which nobody replaces.
_OURS = frozenset({*MATERIALS, *NETWORKS, *PARAMETERS})


def register(thing: Material | Network) -> None:
    """Makes a material, with its laws and parameters, or a network known by its name.

    One whose classes bear the same names as those that were registered under its name replaces it: a cell of a notebook
    is run again.
    raises  UserError where the name, or that of a parameter, is taken by something else, and where ranges do not fit
    """
    if isinstance(thing, Network):
        _require_free("network", thing, NETWORKS.get(thing.name))
        NETWORKS[thing.name] = thing
        return
    if not isinstance(thing, Material):
        raise UserError(f"register got {thing!r}; accepted: a Material or a Network")
    _require_free("material", thing, MATERIALS.get(thing.name))
    check_material(thing)
    others = [material for name, material in MATERIALS.items() if name not in _OURS | {thing.name}]
    theirs = {parameter.name for material in others for parameter in material.physical_parameters}
    own = {parameter.name: parameter for parameter in thing.physical_parameters}
    for name, parameter in own.items():
        if name in _OURS | theirs and PARAMETERS[name] != parameter:
            raise _taken("parameter", name)
    PARAMETERS.update(own)
    MATERIALS[thing.name] = thing


def _require_free(kind: str, thing: Material | Network, known: Material | Network | None) -> None:
    if known in (None, thing):
        return
    if thing.name in _OURS or _classes_of(thing) != _classes_of(known):
        raise _taken(kind, thing.name)


def _classes_of(thing: Any) -> list[str]:
    """Where the classes of its laws are defined, as 'module:class'."""
    laws = [getattr(thing, field, None) for field in ("elastic", "plastic", "viscous")]
    return [f"{law.__module__}:{law.__qualname__}" if isinstance(law, type) else str(law) for law in laws]


def _taken(kind: str, name: str) -> UserError:
    return UserError(f"{kind} '{name}' is there already, and another one; accepted: another name")


def check_material(material: Material) -> None:
    """Refuses laws that are none, names that mean something else, and ranges that do not fit, with a UserError."""
    # the classes of laws load PyTorch, which those of built-in materials are not needed for
    from pcnclaws.laws.base import Elasticity, Plasticity
    from pcnclaws.laws.viscosity import Viscosity

    for field, law, kind in (
        ("elastic", material.elasticity, Elasticity),
        ("plastic", material.plasticity, Plasticity),
        ("viscous", material.viscosity, Viscosity),
    ):
        if not (isinstance(law, type) and issubclass(law, kind)) and (law is not None or field == "elastic"):
            optional = "" if field == "elastic" else ", or None"
            raise UserError(
                f"material '{material.name}': {field}={law!r} is not accepted; accepted: a class of "
                f"{kind.__name__}{optional}"
            )
    if not material.physical_parameters:
        raise UserError(f"material '{material.name}': its laws name no physical_parameters; accepted: one or more")
    for parameter in material.physical_parameters:
        if parameter.name in RESERVED or not parameter.name.isidentifier():
            raise UserError(
                f"material '{material.name}': a parameter cannot be called '{parameter.name}'; accepted: a word of "
                f"Python but for {', '.join(RESERVED)}"
            )
    density: object = material.density
    if isinstance(density, bool) or not isinstance(density, float | int) or not 0.0 < density < math.inf:
        raise UserError(
            f"material '{material.name}': density={density!r} is not accepted; accepted: a positive number [kg/m^3]"
        )
    _check_ranges(material)


def _check_ranges(material: Material) -> None:
    own = {parameter.name: parameter for parameter in material.physical_parameters}
    for name in own:
        if name not in material.ranges:
            raise UserError(
                f"material '{material.name}': ranges['{name}'] is missing; accepted: two numbers, increasing"
            )
    for name, (low, high) in material.ranges.items():
        if name not in own:
            raise unknown_name(f"material '{material.name}': ranges", name, own)
        if not (own[name].accepts(low) and own[name].accepts(high) and low < high):
            raise UserError(
                f"material '{material.name}': ranges['{name}']={(low, high)} is not accepted; accepted: two numbers, "
                f"increasing, each {own[name].accepted}"
            )
    for number, kind in enumerate(material.kinds):
        if wrong := sorted(set(own) ^ {*kind.ranges, *kind.fixed}):
            raise UserError(
                f"material '{material.name}': kinds[{number}] does not fit in {wrong[0]}; accepted: a range or a fixed "
                "value of each of its parameters, and of nothing else"
            )
