"""The comparison holds what the JSON files hold, for all methods, beside the paper's numbers."""

import json
from pathlib import Path
from typing import Any

from benchmarks.pages.comparison import write_comparison


def put(folder: Path, method: str, task: str, **values: Any) -> None:
    path = folder / "sand" / method / f"{task}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    scene = {"mse": 1e-6, "time": [0.0, 0.1, 0.2], "mse_by_frame": [0.0, 1e-7, 1e-5]}
    path.write_text(
        json.dumps({"mse": 1e-6, "stress_error": 0.02, "scenes": [scene], "rollout_seconds": 0.71, **values})
    )


def test_methods_stand_with_their_times_above_the_papers_numbers(tmp_path: Path) -> None:
    folder = tmp_path / "results"
    for task in ("reconstruction", "long_term", "geometry", "unseen"):
        put(folder, "nclaws", task)
        put(folder, "gns", task, stress_error=None)
        put(folder, "analytic", task, mse=0.0, stress_error=0.0)
    put(folder, "nclaws", "unseen", mse=None, stress_error=None, scenes=[{"mse": None}])
    put(folder, "nclaws", "training", seconds=700.0, training={"training_seconds": 600.0})
    page, picture = write_comparison(folder, tmp_path / "page.md")
    assert picture.stat().st_size > 10_000
    lines = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in page.read_text(encoding="utf-8").splitlines()
        if line.startswith("|")
    ]
    rows = {line[0]: line[1:] for line in lines}
    assert rows["NCLaws"] == ["1.0e-06 (2 %)", "1.0e-06 (2 %)", "1.0e-06 (2 %)", "diverged", "10", "0.71"]
    assert rows["the paper's NCLaws"] == ["2.6e-05", "4.2e-05", "3.6e-04", "", "", ""]
    assert rows["GNS"][0] == "1.0e-06 (no stress)"
    assert rows["analytic law, true parameters"] == ["0.0e+00 (0 %)"] * 4 + ["none", "0.71"]
    assert list(rows).index("NCLaws") + 1 == list(rows).index("the paper's NCLaws")
