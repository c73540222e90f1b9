"""Models by name: what a `model` config or a run folder may name, and nothing else is built."""

from collections.abc import Callable, Mapping

from pcnclaws.errors import unknown_name
from pcnclaws.laws.materials import Material
from pcnclaws.laws.neural import build_neural_laws
from pcnclaws.laws.registry import NETWORKS
from pcnclaws.simulation.law_simulator import LawSimulator
from pcnclaws.simulation.motion import SceneSimulator

Fields = Mapping[str, object]


class _Baseline:
    """A model that takes the fields `accepted` of its config, beside the name, and no others."""

    def __init__(self, build: Callable[[Material, Fields], SceneSimulator], *accepted: str) -> None:
        self.build, self.accepted = build, accepted

    def __call__(self, material: Material, fields: Fields) -> SceneSimulator:
        for field in fields:
            if field not in ("name", *self.accepted):
                raise unknown_name("model", field, ("name", *self.accepted))
        return self.build(material, fields)


def _nclaws(material: Material, fields: Fields) -> SceneSimulator:
    from pcnclaws.baselines.nclaws import nclaws

    return LawSimulator(nclaws(material))


def _spline(material: Material, fields: Fields) -> SceneSimulator:
    from pcnclaws.baselines.spline import spline

    return LawSimulator(spline(material, fields))


def _gns(material: Material, fields: Fields) -> SceneSimulator:
    from pcnclaws.baselines.gns import gns

    return gns(material, fields)


def _identified(material: Material, fields: Fields) -> SceneSimulator:
    from pcnclaws.baselines.identified import identified

    return LawSimulator(identified(material))


# Each is loaded when it is asked for: the graph network loads SciPy.
BASELINES: Mapping[str, Callable[[Material, Fields], SceneSimulator]] = {
    "nclaws": _Baseline(_nclaws),
    "spline": _Baseline(_spline, "knots", "reach"),
    "gns": _Baseline(_gns, "width", "message_passing_steps", "radius"),
    "identified": _Baseline(_identified),
}


def build_model(material: Material, model: Fields) -> SceneSimulator:
    """The untrained model of a material from the plain fields of a `model` config.

    raises  UserError for an unknown name, an unknown field or a value that is not accepted
    """
    name = str(model.get("name"))
    if name in NETWORKS:
        return LawSimulator(build_neural_laws(material, model))
    if name not in BASELINES:
        raise unknown_name("model.name", name, (*NETWORKS, *BASELINES))
    return BASELINES[name](material, model)
