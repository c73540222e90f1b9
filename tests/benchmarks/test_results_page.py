"""The page of results holds what the JSON files hold, beside the paper's numbers."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from benchmarks.pages.page import write_page
from pcnclaws.errors import UserError


def put(folder: Path, row: str, task: str, material: str = "sand", **values: Any) -> None:
    path = folder / material / row / f"{task}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({"mse": 1e-8, "stress_error": 0.0123, "scenes": [{"mse": 1e-8}], **values}))


def written(folder: Path, tmp_path: Path) -> str:
    write_page(folder, tmp_path / "page.md")
    return (tmp_path / "page.md").read_text(encoding="utf-8")


def section(text: str, heading: str) -> str:
    _, _, after = text.partition(f"## {heading}\n")
    return after.partition("\n## ")[0]


def cells(text: str, start: str) -> list[str]:
    line = next(line for line in text.splitlines() if line.startswith(f"| {start} |"))
    return [cell.strip() for cell in line.strip("|").split("|")][1:]


@pytest.fixture
def results(tmp_path: Path) -> Path:
    return tmp_path / "results"


def test_rows_tasks_floors_and_the_papers_numbers_stand_side_by_side(results: Path, tmp_path: Path) -> None:
    put(results, "multi", "unseen", mse=3.4e-7, floor={"float64": 2e-14, "half_step": 5e-6})
    put(results, "multi", "outside_range", scenes=[{"mse": None}, {"mse": 1e-8}], stress_error=None)
    put(results, "single", "reconstruction")
    text = section(written(results, tmp_path), "Sand")
    assert cells(text, "") == ["reconstruction", "unseen", "outside range"]
    assert cells(text, "-M") == ["", "3.4e-07 (1.2 %)", "1.0e-08, 1 of 2 diverged"]
    assert cells(text, "-S") == ["1.0e-08 (1.2 %)", "", ""]
    assert cells(text, "the paper's -M") == ["1.5e-04", "2.3e-04", ""]
    assert cells(text, "analytic law, half the time step") == ["", "5.0e-06", ""]
    assert (tmp_path / "images" / "accuracy.png").stat().st_size > 10_000


def test_studies_compare_rows_that_differ_in_one_thing(results: Path, tmp_path: Path) -> None:
    put(results, "quick", "unseen", mse=4e-8)
    put(results, "short", "unseen", mse=2e-8)
    put(results, "multi", "unseen", mse=1e-9)
    put(results, "multi_positions", "unseen", mse=5e-7)
    put(results, "structure", "unseen", mse=3e-3)
    for scenes, mse in ((4, 9e-7), (24, 2e-8)):
        put(results, f"scenes_{scenes}", "unseen", mse=mse)
    put(results, "seed_1", "unseen", mse=8e-8)
    put(results, "try_wide", "unseen", mse=3e-8)
    put(results, "multi_positions", "unseen", "tresca", mse=6e-6)
    text = written(results, tmp_path)
    of_scenes = section(text, "Training scenes")
    assert [cells(of_scenes, count)[0][:7] for count in ("4", "12", "24")] == ["9.0e-07", "4.0e-08", "2.0e-08"]
    of_seeds = section(text, "Seeds")
    assert cells(of_seeds, "seed 0") == ["2.0e-08"]
    assert cells(of_seeds, "mean") == ["5.0e-08"]
    assert cells(of_seeds, "largest over smallest") == ["4"]
    ways = section(text, "Ways of training")
    assert (cells(ways, "as it is")[0][:7], cells(ways, "wide")[0][:7]) == ("4.0e-08", "3.0e-08")
    assert "5.0e-07" in section(text, "Positions only beside keyframes")
    structure = section(text, "What does the structure, what the learning")
    assert cells(structure, "sand")[-1] == "3000000", "the untrained law beside -M"
    assert "6.0e-06" in text.partition("## A law in neither family")[2]
    assert "scenes 4" not in section(text, "Sand"), "a study has a section of its own"


def test_a_folder_without_results_or_with_damaged_ones_is_one_line(results: Path, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="holds no results"):
        written(results, tmp_path)
    put(results, "multi", "unseen")
    (results / "sand" / "multi" / "unseen.json").write_text("{")
    with pytest.raises(UserError, match=r"unseen\.json: not readable"):
        written(results, tmp_path)


def test_the_command_writes_the_page_or_leaves_it(results: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "benchmarks.pages", str(results), str(tmp_path / "page.md")]
    failed = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (failed.returncode, len(failed.stderr.splitlines())) == (2, 1)
    assert not (tmp_path / "page.md").exists()
    put(results, "multi", "unseen")
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "| -M | 1.0e-08 (1.2 %) |" in (tmp_path / "page.md").read_text(encoding="utf-8")
