"""YAML files of plain values: numbers, texts, lists and mappings, nothing that can run or grow as it is read."""

from pathlib import Path
from typing import Any

import yaml

from pcnclaws.errors import UserError

MOST_BYTES = 2**20
# A text of a few aliases of aliases stands for more values than memory holds.
MOST_ALIASES = 20


class _Loader(yaml.SafeLoader):
    """A safe loader that counts aliases."""

    aliases = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            self.aliases += 1
            if self.aliases > MOST_ALIASES:
                raise yaml.YAMLError("too many aliases")
        return super().compose_node(parent, index)


def read_plain_yaml(path: Path) -> Any:
    """What a YAML file holds.

    raises  UserError, one line, for whatever is wrong with the file
    """
    try:
        if path.stat().st_size > MOST_BYTES:
            raise UserError(f"{path} is larger than {MOST_BYTES / 2**20:g} MiB; accepted: a configuration")
        return yaml.load(path.read_text(encoding="utf-8"), _Loader)  # noqa: S506  # a safe loader
    except UserError:
        raise
    except (yaml.YAMLError, ValueError, LookupError, TypeError, AttributeError, OSError, RecursionError) as fault:
        raise UserError(f"{path} cannot be read ({type(fault).__name__})") from fault
