"""The C++ header of a law as a file, with what there is to know of the law at its top."""

from pathlib import Path

from pcnclaws.atomic import replaced_file
from pcnclaws.commands.law_card import CARD
from pcnclaws.commands.law_source import LawSource
from pcnclaws.data.law_packages import law_files
from pcnclaws.laws.exported_header import header_text
from pcnclaws.version import __version__


def write_header(source: LawSource, output: Path) -> None:
    """Writes the header, whose namespace bears the name of the file.

    raises  UserError for a law without kernels
    """
    model, card = source.model, ""
    if source.folder is not None:
        with law_files(source.folder) as folder:
            card = (folder / CARD).read_text(encoding="utf-8") if (folder / CARD).is_file() else ""
    comment = [
        f"A law of {model.material.name}: stress, plastic flow and their tangents, in C++17 without dependencies.",
        f"Written by pcnclaws {__version__} (MIT licence). What programs call is at the end.",
        "",
        *card.splitlines(),
    ]
    text = header_text(model, output.stem, comment)
    with replaced_file(output) as part:
        part.write(text.encode())
