"""Rules of the house that no linter knows."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "pcnclaws"
MOST_ARGUMENTS = 5
# Where models are used by what they offer, whatever they are.
OF_MODELS = {"evaluation", "training", "estimation", "commands"}
KINDS_OF_MODEL = {"Laws", "SceneSimulator", "LawSimulator", "MotionModel", "GraphNetworkSimulator"}
# Functions of C and kernels are called by place.
BY_PLACE = {"compiled", "mpm", "laws"}


def calls() -> Iterator[tuple[str, ast.Call]]:
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call):
                yield f"{path.relative_to(PACKAGE)}:{node.lineno}", node


def test_no_call_has_more_than_five_arguments_by_place() -> None:
    long = [
        f"{where}: {ast.unparse(call.func)}"
        for where, call in calls()
        if len(call.args) > MOST_ARGUMENTS and Path(where).parts[0] not in BY_PLACE
    ]
    assert not [line for line in long if not line.endswith(": log.warning")]


def test_nothing_asks_which_kind_of_model_it_has() -> None:
    asking = [
        f"{where}: {ast.unparse(call)}"
        for where, call in calls()
        if Path(where).parts[0] in OF_MODELS
        and ast.unparse(call.func) in ("isinstance", "issubclass", "type")
        and KINDS_OF_MODEL & set(re.findall(r"\w+", ast.unparse(call.args[-1])))
    ]
    assert asking == []
