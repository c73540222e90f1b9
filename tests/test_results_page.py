"""The page of results holds what the JSON files hold, beside the paper's numbers."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from pcnclaws.errors import UserError
from pcnclaws.results_page import page


def put(folder: Path, row: str, task: str, **values: Any) -> None:
    path = folder / "sand" / row / f"{task}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({"mse": 1e-8, "stress_error": 0.0123, "scenes": [{"mse": 1e-8}], **values}))


def cells(text: str, start: str) -> list[str]:
    (line,) = (line for line in text.splitlines() if line.startswith(f"| {start} |"))
    return [cell.strip() for cell in line.strip("|").split("|")][1:]


def test_rows_tasks_floors_and_the_papers_numbers_stand_side_by_side(tmp_path: Path) -> None:
    put(tmp_path, "multi", "unseen", mse=3.4e-7, floor={"float64": 2e-14, "half_step": 5e-6})
    put(tmp_path, "multi", "outside_range", scenes=[{"mse": None}, {"mse": 1e-8}], stress_error=None)
    put(tmp_path, "single", "reconstruction")
    text = page(tmp_path)
    assert "## Sand" in text
    assert cells(text, "") == ["reconstruction", "unseen", "outside range"]
    assert cells(text, "-M") == ["", "3.4e-07 (1.2 %)", "1.0e-08, 1 of 2 diverged"]
    assert cells(text, "-S") == ["1.0e-08 (1.2 %)", "", ""]
    assert cells(text, "the paper's -M") == ["1.5e-04", "2.3e-04", ""]
    assert cells(text, "analytic law, half the time step") == ["", "5.0e-06", ""]


def test_a_folder_without_results_or_with_damaged_ones_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="holds no results"):
        page(tmp_path)
    put(tmp_path, "multi", "unseen")
    (tmp_path / "sand" / "multi" / "unseen.json").write_text("{")
    with pytest.raises(UserError, match=r"unseen\.json: not readable"):
        page(tmp_path)


def test_the_command_writes_the_page_or_leaves_it(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "pcnclaws.results_page", str(tmp_path / "results"), str(tmp_path / "page.md")]
    failed = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (failed.returncode, len(failed.stderr.splitlines())) == (2, 1)
    assert not (tmp_path / "page.md").exists()
    put(tmp_path / "results", "multi", "unseen")
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "| -M | 1.0e-08 (1.2 %) |" in (tmp_path / "page.md").read_text()
