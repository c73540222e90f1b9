"""The configuration tree: where it is, how it is composed, and Hydra's errors in one line each.

An entry point's options are exactly the keys of its default composition with the chosen groups: a key that this
composition does not know is refused however it was added.
"""

import logging
import re
from collections.abc import Collection, Mapping, Sequence
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any, cast

from hydra import compose, initialize_config_dir
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException, MissingConfigException, OverrideParseException
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

import pcnclaws
from pcnclaws.commands.choices import choices_of, offer_choices
from pcnclaws.commands.folder_names import FolderNames, folder_names
from pcnclaws.commands.options import OPEN_GROUPS, check_options, leaves, unknown_option
from pcnclaws.commands.typed import typed
from pcnclaws.commands.typed_configs import CONFIGS
from pcnclaws.commands.unused_options import check_unused
from pcnclaws.errors import UserError, unknown_name
from pcnclaws.laws.materials import OWN_MATERIAL

log = logging.getLogger(__name__)

CONFIG_ERRORS = (HydraException, OmegaConfBaseException)
HYDRA_VERSION_BASE = "1.3"
GROUP_CHOICE = re.compile(r"(?P<group>[\w/]+)=(?P<choice>[\w.-]+)")
# The option with a word for all of its switches, which are a group of files for Hydra.
SWITCHES = re.compile(r"\+{0,2}simulation\.skip=(?!\{)(?P<words>.*)")
# Longer names of options than a file system has names for.
LONGEST_NAME = 200
SWITCH_WORDS = ("all", "none")


def conf_folder() -> Path:
    """The absolute path of the configuration tree: inside the package of a wheel, beside it in a checkout."""
    package = Path(pcnclaws.__file__).resolve().parent
    packaged = package / "conf"
    return packaged if packaged.is_dir() else package.parent / "conf"


def compose_config(entry: str, overrides: Sequence[str] = ()) -> Any:
    """The checked configuration of an entry point (`train`, ...), as its command would see it, of CONFIGS[entry].

    raises  UserError for whatever the command would refuse
    """
    register_resolvers()
    overrides = as_hydra_reads_them(overrides)
    try:
        offer_choices(overrides)
        return checked(entry, _compose(entry, overrides), overrides)
    except CONFIG_ERRORS as error:
        raise explain(entry, overrides, error) from error


def composed_groups(entry: str, overrides: Sequence[str]) -> tuple[DictConfig, list[str]]:
    """The options of an entry point, neither resolved nor checked, and the names of its groups."""
    config = _compose(entry, overrides, with_hydra=True)
    groups = [group for group in config.hydra.runtime.choices if not group.startswith("hydra/")]
    return OmegaConf.masked_copy(config, [str(name) for name in config if name != "hydra"]), groups


def as_hydra_reads_them(overrides: Sequence[str]) -> list[str]:
    """The overrides with `simulation.skip=none` as the choice of a group, and those of an open group as additions.

    raises  UserError for what Hydra would look for among the files and fail: endless names, and a list for a group
    """
    for override in overrides:
        name, _, value = override.partition("=")
        if len(name) > LONGEST_NAME:
            raise UserError(f"option='{name[:40]}...' is not known; accepted: what --help lists, no names so long")
        group = name.lstrip("+")
        listed, long = value.startswith("["), any(len(word) > LONGEST_NAME for word in value.split(","))
        if (listed or long) and (choices := _choices(group)):
            raise UserError(f"{override[:80]} is not accepted; accepted: one of {', '.join(sorted(choices))}")
    return [_as_addition(_as_group_choice(override)) for override in overrides]


def _choices(group: str) -> set[str]:
    """What a group of options may be, empty for what is no group."""
    if not re.fullmatch(r"[\w/]+", group):
        return set()
    return {*(path.stem for path in (conf_folder() / group).glob("*.yaml")), *choices_of(group)}


def checked(entry: str, config: DictConfig, overrides: Sequence[str], swept: Collection[str] = ()) -> Any:
    """The configuration, resolved and typed, after a look at every option; UserError for the first wrong one.

    swept  the options that differ between the jobs of a sweep
    """
    resolved = _resolved(config, folder_names(overrides, swept))
    options = dict(leaves(resolved))
    check_options(options, _defaults(entry, overrides))
    check_unused(entry, _written(overrides, options), options)
    return typed(CONFIGS[entry], resolved)


def explain(entry: str, overrides: Sequence[str], error: Exception) -> UserError:
    """One line of ours for an error of Hydra or OmegaConf."""
    if isinstance(error, MissingConfigException) and error.options is not None:
        group, _, name = str(error.missing_cfg_file).rpartition("/")
        more = OWN_MATERIAL if group == "material" else ""
        return unknown_name(group.replace("/", "."), name, error.options, more)
    if isinstance(error, OverrideParseException):
        return UserError(
            f"'{error.override}' cannot be read; accepted: option=value, a value with special characters in quotes"
        )
    if match := re.search(r"Could not override '([^'@]+)'", str(error)):
        if match[1].startswith("hydra."):
            return UserError(f"option='{match[1]}' is not known; accepted: what --cfg hydra lists")
        return unknown_option(match[1], _defaults_without(match[1], entry, overrides))
    where = error.full_key if isinstance(error, OmegaConfBaseException) and error.full_key else " ".join(overrides)
    text = str(error).partition("full_key")[0]
    return UserError(f"{where}: {'; '.join(line.strip() for line in text.splitlines() if line.strip())}")


def register_resolvers(names: FolderNames | None = None) -> None:
    """`${apart:}`, `${job_folder:}` and `${sweep_folder:}`, the parts of default paths; empty without names."""
    apart, job, sweep = names or FolderNames()
    OmegaConf.register_new_resolver("apart", lambda: apart, replace=True)
    OmegaConf.register_new_resolver("job_folder", lambda: job, replace=True)
    OmegaConf.register_new_resolver("sweep_folder", lambda: sweep, replace=True)


def task_overrides() -> list[str]:
    """The overrides of the running job, as they were written: their interpolations belong to another configuration."""
    return cast(list[str], OmegaConf.to_container(HydraConfig.get().overrides.task, resolve=False))


def is_of_sweep() -> bool:
    """Whether the running job is one of a sweep."""
    return HydraConfig.initialized() and HydraConfig.get().mode == RunMode.MULTIRUN


def stated_options(group: str) -> list[str]:
    """What the running job states of a group of options: all else has its value because nobody chose another.

    Names within the group of options, or of nodes that hold them, stated on the command line, by the experiment, by
    debug=, or by the file of the group that was chosen: another one than the default, or the default by its name.
    What that file takes over from other files is not stated.
    """
    job = HydraConfig.get()
    choices, by_default = job.runtime.choices, _file(str(job.job.config_name))["defaults"]
    named = [override.key_or_group for override in OverridesParser.create().parse_overrides(task_overrides())]
    stated = [name.removeprefix(f"{group}.") for name in named if name.startswith(f"{group}.")]
    if group in named or {group: choices[group]} not in by_default:
        stated += file_options(group, choices[group])
    for name in ("experiment", "debug"):
        if choices.get(name):
            stated += dict(leaves(_file(f"{name}/{choices[name]}").get(group, {})))
    return stated


def file_options(group: str, choice: str) -> dict[str, Any]:
    """The options that one file of a group holds itself, by their names within the group."""
    options = _file(f"{group}/{choice}")
    options.pop("defaults", None)
    return dict(leaves(options))


def whole_file_options(group: str, choice: str) -> dict[str, Any]:
    """The options of one file of a group, with those of the files of the group that it builds on."""
    bases = [base for base in _file(f"{group}/{choice}").get("defaults", []) if base != "_self_"]
    options: dict[str, Any] = {}
    for base in bases:
        options |= whole_file_options(group, base)
    return options | file_options(group, choice)


def _file(name: str) -> dict[str, Any]:
    options = OmegaConf.load(conf_folder() / f"{name}.yaml")
    return cast(dict[str, Any], OmegaConf.to_container(options, resolve=False))


def _written(overrides: Sequence[str], options: Mapping[str, Any]) -> dict[str, Any]:
    """What the command line sets: the values of options and the choices of groups by name. Two values get a line."""
    written: dict[str, Any] = {}
    for override in OverridesParser.create().parse_overrides(list(overrides)):
        if override.is_delete():
            continue
        name = override.key_or_group.replace("/", ".")
        below = [option for option in options if option.startswith(f"{name}.")]
        # `unknown={motion: true}` sets an option below, the choice of a group sets none
        names = below if isinstance(override.value(), dict) else [name]
        for each in names:
            if each in written:
                log.warning("%s is given twice: %s counts", each, options.get(each, override.value()))
            written[each] = options.get(each, override.value())
    return written


def _as_group_choice(override: str) -> str:
    match = SWITCHES.fullmatch(override)
    if not match:
        return override
    for word in match["words"].split(","):  # several in a sweep
        if word not in SWITCH_WORDS:
            raise unknown_name("simulation.skip", word, SWITCH_WORDS)
    return f"simulation/skip={match['words']}"


def _as_addition(override: str) -> str:
    return f"++{override}" if override.startswith(OPEN_GROUPS) else override


def _compose(entry: str, overrides: Sequence[str], with_hydra: bool = False) -> DictConfig:
    if GlobalHydra.instance().is_initialized():
        return compose(entry, list(overrides), with_hydra)
    with initialize_config_dir(version_base=HYDRA_VERSION_BASE, config_dir=str(conf_folder())):
        return compose(entry, list(overrides), with_hydra)


def _defaults(entry: str, overrides: Sequence[str]) -> Mapping[str, Any]:
    """The options of the composition with the existing groups that the overrides choose, and no other override."""
    chosen = []
    for override in overrides:
        match = GROUP_CHOICE.fullmatch(override)
        if match and _exists(match["group"], match["choice"]):
            chosen.append(override)
    try:
        return _options(entry, tuple(chosen))
    except CONFIG_ERRORS:  # a group that this entry point does not have
        return _options(entry, ())


def _exists(group: str, choice: str) -> bool:
    return choice in _choices(group)


@cache
def _options(entry: str, groups: tuple[str, ...]) -> Mapping[str, Any]:
    return dict(leaves(_resolved(_compose(entry, groups))))


def _defaults_without(option: str, entry: str, overrides: Sequence[str]) -> Mapping[str, Any]:
    """The options of the first job of a sweep that does not have this one."""
    sweeps = [override.partition("=") for override in overrides]
    choices = [[f"{name}={value}" for value in values.split(",")] for name, _, values in sweeps]
    jobs = [_defaults(entry, job) for job in product(*choices)]
    return next((options for options in jobs if option not in options), jobs[0])


def _resolved(config: DictConfig, names: FolderNames | None = None) -> dict[str, Any]:
    register_resolvers(names)
    return cast(dict[str, Any], OmegaConf.to_container(config, resolve=True, throw_on_missing=True))
