"""The page of the unified law is what its command writes, and says of each body what it is."""

import json
from pathlib import Path

from benchmarks.pages.unified import KINDS, page
from benchmarks.which_material import answer
from pcnclaws.laws.materials import MATERIALS

DOCS = Path(__file__).parents[2] / "docs"


def test_the_page_is_what_its_command_writes() -> None:
    text = page(DOCS / "results")
    assert (DOCS / "unified.md").read_text(encoding="utf-8") == text
    for kind in KINDS:
        assert f"| **{kind}** | mean |" in text


def test_every_reference_object_is_told_to_be_of_its_material_and_found_with_its_parameters() -> None:
    document = json.loads((DOCS / "results" / "unified" / "which_material.json").read_text(encoding="utf-8"))
    exact = [row for row in document["results"]["rows"] if row["noise"] == 0.0]
    assert [row["object"] for row in sorted(exact, key=lambda row: KINDS.index(row["kind"]))] == [
        thing.name for kind in KINDS for thing in MATERIALS[kind].objects
    ]
    for row in exact:
        assert answer(row) == row["kind"]
        for name, value in row["explained"][row["kind"]]["parameters"].items():
            assert value is not None
            assert abs(value / row["truth"][name] - 1.0) < 0.01
