"""Verification: every row stays where it was declared, and the page says what the result file holds."""

import json
from pathlib import Path

import pytest

from benchmarks.__main__ import benchmark
from benchmarks.pages.verification import page, write_verification
from benchmarks.verification.cases import CASES

MEASURED = [case for case in CASES.values() if case.measure is not None]


@pytest.mark.parametrize(
    "name", [pytest.param(case.name, marks=pytest.mark.slow) if case.slow else case.name for case in MEASURED]
)
def test_a_row_is_within_its_tolerance_unless_the_page_says_why_not(name: str) -> None:
    row = CASES[name].row()
    assert row["verdict"] == CASES[name].expected, f"{row['ours']} beside {row['theirs']}: {row['difference']:.3g}"


def test_rows_are_kept_and_the_page_is_made_of_them(in_process, tmp_path: Path) -> None:
    chosen = "problem.cases=[drucker_prager_cone,friction_angle,taylor_bar]"
    outcome = in_process(benchmark, "benchmark", "problem=verification", chosen, "output=o")
    assert outcome.status == 0, outcome.err
    document = json.loads((tmp_path / "o" / "verification.json").read_text())
    cone, angles, bar = document["results"]["rows"]
    assert cone["ours"] == pytest.approx(cone["theirs"], rel=cone["tolerance"])
    assert (bar["verdict"], "ours" in bar) == ("not had", False)
    text = (tmp_path / "o" / "verification.md").read_text()
    assert all(row["sentence"] in text for row in document["results"]["rows"])
    assert all(f"| {' | '.join(line)} |" in text for line in angles["table"]["lines"])
    assert (tmp_path / "o" / "verification" / "friction_angle.png").is_file()
    assert not (tmp_path / "docs").exists()  # of the whole table alone

    document["results"]["rows"][0] |= {"verdict": "outside", "why": "the moon was full"}
    write_verification(document, tmp_path / "new.md", tmp_path / "images")
    assert "`drucker_prager_cone`: the moon was full" in (tmp_path / "new.md").read_text()


def test_a_case_that_is_not_there_is_refused_with_the_nearest_one(in_process) -> None:
    outcome = in_process(benchmark, "benchmark", "problem=verification", "problem.cases=[j2_perfekt]", "output=o")
    assert outcome.status == 2
    assert "did you mean 'j2_perfect'" in outcome.err


def test_the_page_tells_the_committed_results_of_all_cases() -> None:
    docs = Path(__file__).parents[2] / "docs"
    rows = json.loads((docs / "results" / "verification.json").read_text(encoding="utf-8"))["results"]["rows"]
    assert [row["name"] for row in rows] == list(CASES)
    assert {row["name"]: row["verdict"] for row in rows} == {name: case.expected for name, case in CASES.items()}
    images = docs / "images" / "verification"
    pictures = {row["name"]: images / f"{row['name']}.png" for row in rows if row.get("curve")}
    assert all(path.is_file() for path in pictures.values())
    assert page(rows, pictures, docs, "verification.json") == (docs / "verification.md").read_text(encoding="utf-8")
