"""The page of the unified law is what its command writes, and each body is told to be what it is."""

from pathlib import Path

import pytest

from benchmarks.pages.unified import KINDS, OBJECTS, page
from pcnclaws.laws.materials import MATERIALS

DOCS = Path(__file__).parents[2] / "docs"


def test_the_page_is_what_its_command_writes() -> None:
    text = page(DOCS / "results")
    assert (DOCS / "unified.md").read_text(encoding="utf-8") == text
    for kind in KINDS:
        assert f"| **{kind}** | mean |" in text


@pytest.mark.parametrize("kind", KINDS)
def test_the_objects_of_the_page_are_the_papers(kind: str) -> None:
    own = [values for name, values in OBJECTS.items() if name.startswith(kind)]
    assert sorted(own) == sorted(tuple(thing.parameters.values()) for thing in MATERIALS[kind].objects)
