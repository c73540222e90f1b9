"""PC-NCLaws: elastic and plastic laws as neural networks conditioned on the physical parameters, by name."""

from collections.abc import Mapping

from pcnclaws.errors import UserError, unknown_name
from pcnclaws.laws.analytic import Laws
from pcnclaws.laws.materials import Material
from pcnclaws.laws.registry import NETWORKS

LARGEST_WIDTH = 1024


def build_neural_laws(material: Material, model: Mapping[str, object]) -> Laws:
    """Untrained neural laws of a material from the plain fields of a `model` config: name and width.

    A purely elastic material gets no plastic network at all; a viscous law is the material's own.
    """
    fields = dict(model)
    name = fields.pop("name", None)
    if name not in NETWORKS:
        raise unknown_name("model.name", name, NETWORKS)
    network = NETWORKS[str(name)]
    width = fields.pop("width", network.width)
    if fields:
        raise unknown_name("model", next(iter(fields)), ("name", "width"))
    if isinstance(width, bool) or not isinstance(width, int) or not 1 <= width <= LARGEST_WIDTH:
        raise UserError(f"model.width={width} is not accepted; accepted: a whole number from 1 to {LARGEST_WIDTH}")
    plastic = network.plasticity(material, width) if material.plasticity else None
    viscous = material.viscosity() if material.viscosity else None
    return Laws(network.elasticity(material, width), plastic, viscous)
