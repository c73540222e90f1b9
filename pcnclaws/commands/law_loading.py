"""Laws by name for programs: the weights that ship for a material, those of a run folder, or a packaged law."""

from pathlib import Path

from pcnclaws.commands.runs import PRETRAINED, WEIGHTS, load_run, shipped_folder
from pcnclaws.errors import UserError, unknown_name
from pcnclaws.laws.constitutive_model import ConstitutiveModel
from pcnclaws.laws.materials import MATERIALS


def load_law(source: str | Path) -> ConstitutiveModel:
    """The trained law of a material whose weights ship with the package, of a run folder, or of a packaged law.

    Reading it never runs code from its files. Its weights are frozen until `law.requires_grad_()`.
    source  the name of a material, or the path of a run folder or of a packaged law (law.zip)
    raises  UserError where there is no such law, where its files are damaged, and where a packaged law needs what is
            not here: a plugin, a later version
    """
    if not isinstance(source, str | Path):
        raise UserError(
            f"law={source!r} is not accepted; accepted: the name of a material, or the path of a run folder or of a "
            "packaged law"
        )
    folder = Path(source)
    if str(source) in MATERIALS:
        folder = shipped_folder(MATERIALS[str(source)])
    elif not folder.exists():
        shipped = [path.parent.name for path in PRETRAINED.glob(f"*/{WEIGHTS}")]
        raise UserError(f"{unknown_name('law', source, shipped)}; or the path of a run folder or of a packaged law")
    run = load_run(folder)
    return ConstitutiveModel(run.material, run.laws, run.ranges, str(source))
