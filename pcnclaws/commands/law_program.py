"""The AOTInductor package and the ONNX graph of a law as files."""

from pathlib import Path

from pcnclaws.atomic import replaced_file
from pcnclaws.commands.law_source import LawSource
from pcnclaws.laws.exported_graph import onnx_graph
from pcnclaws.laws.exported_program import program_package


def write_program(source: LawSource, output: Path) -> None:
    """Writes the package, whole or not at all; it takes minutes.

    raises  UserError for a law that none is made of, and without a C++ compiler
    """
    print("compiling the law with PyTorch: some minutes", flush=True)
    with replaced_file(output) as part:
        part.write(program_package(source.model))


def write_graph(source: LawSource, output: Path) -> None:
    """Writes the graph, whole or not at all; it takes half a minute.

    raises  UserError for a law that none is made of, and without the packages that make it
    """
    data = onnx_graph(source.model)
    with replaced_file(output) as part:
        part.write(data)
