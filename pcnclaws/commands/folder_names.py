"""Names of folders after the options that tell them apart, short and the same for the same options."""

import re
from collections.abc import Collection, Iterable, Sequence
from hashlib import sha256
from typing import NamedTuple

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override

from pcnclaws.commands.options import is_free

LONGEST_NAME = 100
# What `name` of a training is made of: the last of these groups that is chosen names the run folder.
NAMING = (("debug",), ("experiment",), ("material", "model", "regime"))
# What a name shows as it is written, but for the brackets of a list. A point is that of a number: what ends in .h5 is
# no folder.
PLAIN = re.compile(r"([\w,\[\]+-]|\.(?=\d))*", re.ASCII)


class FolderNames(NamedTuple):
    """Parts of default paths, empty where there is nothing to tell apart.

    apart  "_option-value_..." of the options that are the same in all jobs and change what comes out
    job    "/option-value_..." of the swept options
    sweep  both as folders, in a sweep alone
    """

    apart: str = ""
    job: str = ""
    sweep: str = ""


def folder_names(overrides: Sequence[str], swept: Collection[str] = ()) -> FolderNames:
    """The parts of the default paths of one job.

    overrides  of the job, as they were written
    swept      the options that differ between the jobs of its sweep
    """
    parsed = OverridesParser.create().parse_overrides(list(overrides))
    keys = {override.key_or_group for override in parsed}
    naming = next((groups for groups in NAMING if keys.intersection(groups)), NAMING[-1])
    fixed = [one for one in parsed if one.key_or_group not in swept and one.key_or_group not in naming and _counts(one)]
    varied = [one for one in parsed if one.key_or_group in swept and one.key_or_group not in ("experiment", "debug")]
    apart, job = ("" if "name" in keys else _name(fixed)), _name(varied)
    levels = [part for part in (apart, job) if part] if swept else []
    return FolderNames(f"_{apart}" if apart else "", f"/{job}" if job else "", "".join(f"/{part}" for part in levels))


def swept_options(overrides: Sequence[str]) -> list[str]:
    """The options that have several values on this command line."""
    parsed = OverridesParser.create().parse_overrides(list(overrides))
    return [override.key_or_group for override in parsed if override.is_sweep_override()]


def _counts(override: Override) -> bool:
    return not override.is_delete() and not is_free(override.key_or_group.replace("/", "."))


def _name(overrides: Iterable[Override]) -> str:
    """The options with their values, sorted, with the last words of their names where all of them are too long."""
    values = sorted((override.key_or_group.replace("/", "."), _value(override)) for override in overrides)
    name = "_".join(f"{option}-{value}" for option, value in values)
    if len(name) > LONGEST_NAME:
        brief = "_".join(f"{option.rpartition('.')[2]}-{value}" for option, value in values)
        digest = sha256(name.encode()).hexdigest()[:8]
        name = f"{brief[: LONGEST_NAME - len(digest) - 1]}-{digest}"
    return name


def _value(override: Override) -> str:
    """A value in letters that every shell and file system takes; with a digest where others were left out."""
    text = override.get_value_element_as_str()
    short = re.sub(r"[^A-Za-z0-9.+-]+|\.(?!\d)", "_", text).strip("_").replace("+", "")
    return short if PLAIN.fullmatch(text) else f"{short}-{sha256(text.encode()).hexdigest()[:6]}"
