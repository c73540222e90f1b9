"""A law by the option `law` alone, beside no motion: a material's name, analytic, pretrained, a run or a package."""

from pathlib import Path
from typing import NamedTuple

from pcnclaws.commands.law_loading import load_law
from pcnclaws.commands.runs import shipped_folder
from pcnclaws.errors import UserError
from pcnclaws.laws.constitutive_model import ConstitutiveModel, analytic_law
from pcnclaws.laws.materials import MATERIALS, material_named

WORDS = ("analytic", "pretrained")


class LawSource(NamedTuple):
    """A law and where it is: its run folder or package, None for an analytic law."""

    model: ConstitutiveModel
    folder: Path | None


def law_source(law: str, material: str | None) -> LawSource:
    """The law that `law` and `material` name.

    law       the name of a material whose weights ship, the path of a run folder or of a packaged law; with a material
              analytic or pretrained
    material  its name, None where the law says it
    raises    UserError
    """
    if law in WORDS:
        if material is None:
            raise UserError(f"law={law} needs material=; accepted: {', '.join(sorted(MATERIALS))}, or one of a plugin")
        known = material_named(material)
        if law == "analytic":
            return LawSource(analytic_law(known), None)
        law, folder = material, shipped_folder(known)
    else:
        folder = shipped_folder(MATERIALS[law]) if law in MATERIALS else Path(law)
    model = load_law(law if law in MATERIALS else folder)
    if material not in (None, model.material.name):
        raise UserError(f"law={law} was trained for material={model.material.name}, not {material}")
    return LawSource(model, folder)
