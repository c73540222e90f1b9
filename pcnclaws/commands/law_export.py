"""Export of a law alone, from its typed options to the file of another program."""

from pathlib import Path

from pcnclaws.commands.export_format import chosen_format, with_ending
from pcnclaws.commands.law_header import write_header
from pcnclaws.commands.law_package import write_package
from pcnclaws.commands.law_program import write_graph, write_program
from pcnclaws.commands.law_source import law_source
from pcnclaws.commands.outputs import output_file
from pcnclaws.commands.typed_configs import ExportConfig
from pcnclaws.errors import UserError

# What the words of `format=` stand for: endings, the first one where output= has none.
ENDINGS = {"zip": (".zip",), "cpp": (".hpp", ".h"), "pt2": (".pt2",), "onnx": (".onnx",)}
WRITERS = {"zip": write_package, "cpp": write_header, "pt2": write_program, "onnx": write_graph}


def export_law(config: ExportConfig) -> None:
    """Writes a law as a file of the format that `format` or the ending of `output` names."""
    chosen = chosen_format(config, ENDINGS)
    path = with_ending(config, ENDINGS[chosen])
    material = None if config.material is None else config.material["name"]
    if not isinstance(config.law, str) or not config.law:
        raise UserError(f"law={config.law} is not accepted; accepted: the name of a material, or a path")
    source = law_source(config.law, material)
    read = {"law": source.folder if source.folder is not None and source.folder.is_file() else None}
    output = output_file(str(path), read, *ENDINGS[chosen])
    WRITERS[chosen](source, output)
    print(f"wrote {output}: law '{config.law}' of {source.model.material.name}, {_size(output)}")


def _size(file: Path) -> str:
    return f"{file.stat().st_size / 1000:.0f} kB"
