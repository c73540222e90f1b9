"""Docstrings of the house for the API reference: their columns of names and meanings become lists.

A block of lines such as

    steps   number of steps
    every   steps between two frames,
            at least 1

is a list with an entry for each name; formulas, which are indented, are code already.
"""

import re
from typing import Any

import griffe

ENTRY = re.compile(r"(?P<names>[\w.]+(?:, [\w.]+)*) {2,}(?P<words>\S.*)")


class HouseDocstrings(griffe.Extension):
    """Rewrites the docstring of every object."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Called for each module, class, function and attribute."""
        if obj.docstring:
            obj.docstring.value = with_lists(obj.docstring.value)


def with_lists(text: str) -> str:
    """The text with its columns as a list in Markdown."""
    lines: list[str] = []
    column = 0  # of the meanings, within a list
    for line in text.splitlines():
        if match := ENTRY.fullmatch(line):
            if not column and lines and lines[-1]:
                lines.append("")
            column = match.start("words")
            lines.append(f"- `{match['names']}`: {match['words']}")
        elif column and line.startswith(" " * column) and line.strip():
            lines.append(f"    {line.strip()}")
        else:
            column = 0
            lines.append(line)
    return "\n".join(lines)
