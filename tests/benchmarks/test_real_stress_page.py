"""The page of measured stress says what its result file says."""

import json
from pathlib import Path

from benchmarks.pages.real_stress import MOST_TRAINED, SCENES_FILE, page

RESULT = Path(__file__).parents[2] / "docs" / "results" / "real_stress.json"


def test_the_page_is_that_of_the_result() -> None:
    found = json.loads(RESULT.read_text(encoding="utf-8"))
    scenes = json.loads(RESULT.with_name(SCENES_FILE).read_text(encoding="utf-8"))
    assert (RESULT.parents[1] / "real_stress.md").read_text(encoding="utf-8") == page(found, scenes)


def test_the_foams_are_learned_where_laws_of_textbooks_are_far_off() -> None:
    found = json.loads(RESULT.read_text(encoding="utf-8"))
    for foam in ("leap", "turbo"):
        for row in found[f"foam {foam}"]["paths"]:
            assert row["relative_rms"] <= MOST_TRAINED
            assert min(errors[row["name"]] for errors in found[f"foam {foam}"]["textbook"].values()) > 0.1
