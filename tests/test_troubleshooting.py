"""docs/troubleshooting.md has an entry for each message that refuses something, and no entry for none."""

import ast
import re
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

from conftest import Outcome

from pcnclaws.simulate import simulate

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "troubleshooting.md"
FAILURES = {"UserError", "SimulationDiverged", "ParticleEscaped", "CannotWrite"}
# Command lines that Hydra refuses, and its words.
OF_HYDRA = {
    "--fast": "unrecognized arguments: --fast",
    "simulation.steps=1,2": "Ambiguous value for argument 'simulation.steps=1,2'",
    "output=${nowhere}": "Interpolation key 'nowhere' not found",
    "material=null": "Config group override must be a string or a list",
}
# Stands for what a message says of its case.
ANY = "\N{HORIZONTAL ELLIPSIS}"
# A message with fewer letters of its own is made of another one.
LEAST = 8


def template(node: ast.expr) -> Iterator[str]:
    """The texts that an expression may be, with ANY for what is put in."""
    match node:
        case ast.Constant(value=str(text)):
            yield re.sub(r"%(?:\.\d)?[sdgfe]", ANY, text)
        case ast.JoinedStr():
            yield "".join(str(part.value) if isinstance(part, ast.Constant) else ANY for part in node.values)
        case ast.BinOp(op=ast.Add()):
            yield from (left + right for left in template(node.left) for right in template(node.right))
        case ast.IfExp():
            yield from (*template(node.body), *template(node.orelse))
        case _:
            yield ANY


@cache
def trees() -> dict[str, ast.Module]:
    files = sorted((ROOT / "pcnclaws").rglob("*.py"))
    return {str(path.relative_to(ROOT)): ast.parse(path.read_text(encoding="utf-8")) for path in files}


def refusals() -> Iterator[tuple[str, str]]:
    """Where the package fails, and the texts that it may say there, but for those that are made elsewhere."""
    for file, tree in trees().items():
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and node.args and ast.unparse(node.func) in FAILURES:
                for text in template(node.args[0]):
                    if len(re.findall(r"[a-z]", text.replace("accepted", ""))) >= LEAST:
                        yield f"{file}:{node.lineno}", text


def texts() -> Iterator[str]:
    """The lines of text in the package."""
    for tree in trees().values():
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant | ast.JoinedStr | ast.BinOp):
                yield from (text for text in template(node) if " " in text and "\n" not in text)


@cache
def entries() -> dict[str, re.Pattern[str]]:
    """The messages of the page, each with a pattern that it fits."""
    found = re.findall(r"^> `(.+)`$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    return {entry: re.compile(".*".join(map(re.escape, entry.split("...")))) for entry in found}


def has_entry(message: str) -> bool:
    return any(pattern.search(message.replace(ANY, "x, x")) for pattern in entries().values())


def test_every_refusal_has_an_entry() -> None:
    lost = [(where, text) for where, text in refusals() if not has_entry(text)]
    assert not lost, "\n".join(f"{where}: {text}" for where, text in lost)


def test_every_entry_is_of_a_message() -> None:
    said = "\n".join({*texts(), *OF_HYDRA.values()}).replace(ANY, "x, x")
    assert entries()
    assert not [entry for entry, pattern in entries().items() if not pattern.search(said)]


def test_what_hydra_refuses_has_an_entry(in_process: Callable[..., Outcome]) -> None:
    for argument, words in OF_HYDRA.items():
        said = in_process(simulate, "simulate", argument).err
        assert words in said
        assert has_entry(said)
