"""The format of an export: the word of `format`, or what the ending of `output` says."""

from collections.abc import Mapping
from pathlib import Path

from pcnclaws.commands.typed_configs import ExportConfig
from pcnclaws.errors import UserError, unknown_name

Endings = Mapping[str, tuple[str, ...]]


def chosen_format(config: ExportConfig, known: Endings) -> str:
    """One of the words that are known.

    known   the endings of files of each format
    raises  UserError where nothing names one, and where `format` and `output` say different things
    """
    ending = Path(str(config.output)).suffix.lower()
    said = next((word for word, endings in known.items() if ending in endings), None)
    if config.format is None:
        if said is None:
            every = [ending for endings in known.values() for ending in endings]
            raise UserError(
                f"format=null and output={config.output} name no format; accepted: format={', '.join(known)}, or "
                f"an output= that ends in {', '.join(every)}"
            )
        return said
    if config.format not in known:
        raise unknown_name("format", config.format, known)
    if said not in (None, config.format):
        raise UserError(
            f"output={config.output} is not of format={config.format}; accepted: a file that ends in "
            f"{' or '.join(known[config.format])}, or no ending"
        )
    return config.format


def with_ending(config: ExportConfig, endings: tuple[str, ...]) -> Path:
    """The path of `output` with an ending of the format."""
    path = Path(str(config.output))
    return path if path.suffix.lower() in endings else path.with_name(f"{path.name}{endings[0]}")
