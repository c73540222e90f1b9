"""PC-NCLaws: elastic and plastic laws as neural networks conditioned on the physical parameters, by name."""

from collections.abc import Mapping

from pcnclaws.errors import UserError, unknown_name
from pcnclaws.laws.analytic import Laws
from pcnclaws.laws.materials import Material
from pcnclaws.laws.neural_default import ElasticNet, PlasticNet
from pcnclaws.laws.neural_free_flow import FreeFlowPlasticNet
from pcnclaws.laws.neural_no_prior import NoPriorElasticNet, NoPriorPlasticNet
from pcnclaws.laws.neural_paper import PaperElasticNet, PaperPlasticNet

VARIANTS = {
    "pcnclaws": (ElasticNet, PlasticNet),
    "pcnclaws_free_flow": (ElasticNet, FreeFlowPlasticNet),
    "pcnclaws_no_prior": (NoPriorElasticNet, NoPriorPlasticNet),
    "pcnclaws_paper": (PaperElasticNet, PaperPlasticNet),
}
LARGEST_WIDTH = 1024


def build_neural_laws(material: Material, model: Mapping[str, object]) -> Laws:
    """Untrained neural laws of a material from the plain fields of a `model` config: name and width.

    A purely elastic material gets no plastic network at all.
    """
    fields = dict(model)
    name, width = fields.pop("name", None), fields.pop("width", 64)
    if name not in VARIANTS:
        raise unknown_name("model.name", name, VARIANTS)
    if fields:
        raise unknown_name("model", next(iter(fields)), ("name", "width"))
    if isinstance(width, bool) or not isinstance(width, int) or not 1 <= width <= LARGEST_WIDTH:
        raise UserError(f"model.width={width} is not accepted; accepted: a whole number from 1 to {LARGEST_WIDTH}")
    elastic, plastic = VARIANTS[str(name)]
    return Laws(elastic(material, width), plastic(material, width) if material.plasticity else None)
