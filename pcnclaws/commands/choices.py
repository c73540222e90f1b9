"""Configuration of what is known by name: the choices of the groups that materials and networks make.

`material`, `parameters`, `initial_guess` and `fixed` have a choice for each material, `model` one for each network: the
objects are the only place that says what there is.
"""

import importlib
from collections.abc import Sequence

from hydra.core.config_store import ConfigStore
from hydra.core.override_parser.overrides_parser import OverridesParser

from pcnclaws.errors import UserError
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.laws.registry import NETWORKS

PLUGINS = "plugins"


def offer_choices(overrides: Sequence[str] = ()) -> None:
    """Makes the choices known to Hydra, those of the plugins that the command line names among them.

    raises  UserError for a plugin that cannot be imported
    """
    _import_plugins(overrides)
    store = ConfigStore.instance()
    for name, material in MATERIALS.items():
        unsaid = dict.fromkeys(material.parameter_names)
        for group, node in (
            ("material", {"name": name}),
            ("parameters", material.defaults),
            ("initial_guess", unsaid),
            ("fixed", unsaid),
        ):
            store.store(name, node, group)
    for name, network in NETWORKS.items():
        store.store(name, {"name": name, "width": network.width}, "model")


def import_plugins(modules: Sequence[str]) -> None:
    """Imports modules of the user; UserError for one that cannot be imported."""
    for module in modules:
        try:
            importlib.import_module(module)
        except ImportError as error:
            raise UserError(
                f"plugins={module} cannot be imported ({error}); accepted: modules that Python finds from here"
            ) from error
        except UserError:
            raise
        except Exception as error:  # whatever their code raises
            raise UserError(f"plugins={module} fails: {type(error).__name__}: {error}") from error


def choices_of(group: str) -> list[str]:
    """The choices of a group that objects make."""
    return [file.removesuffix(".yaml") for file in ConfigStore.instance().repo.get(group, {})]


def _import_plugins(overrides: Sequence[str]) -> None:
    for override in OverridesParser.create().parse_overrides(list(overrides)):
        if override.key_or_group != PLUGINS or override.is_delete():
            continue
        modules = override.value()
        if not isinstance(modules, list) or not all(isinstance(module, str) for module in modules):
            raise UserError(f"plugins={modules} is not accepted; accepted: a list of modules, such as [my_material]")
        import_plugins(modules)
