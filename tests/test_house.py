"""Rules of the house that no linter knows."""

import ast
from collections.abc import Iterator
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "pcnclaws"
MOST_ARGUMENTS = 5
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
