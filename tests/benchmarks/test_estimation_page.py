"""The page of estimates is what its JSON files say."""

import json
from pathlib import Path

import pytest

from benchmarks.pages.estimates import estimates, estimation_page
from benchmarks.pages.searches import compared_searches, searches_picture
from pcnclaws.errors import UserError

NU = "\N{GREEK SMALL LETTER NU}"


def document(estimate: float | None, interval: tuple[float, float] | None) -> str:
    modulus = {
        "guess": 5e4,
        "truth": 1.8e5,
        "estimate": estimate,
        "interval_95": interval,
        "identifiable": estimate is not None,
    }
    ratio = {"guess": 0.02, "truth": 0.13, "estimate": 0.128, "interval_95": [0.12, 0.14], "identifiable": True}
    values = {"youngs_modulus": modulus, "poissons_ratio": ratio}
    return json.dumps({"parameters": values, "mse": 1e-9, "iterations": 6, "seconds": 12.3})


def test_every_way_is_a_line_beside_truth_guess_and_paper(tmp_path: Path) -> None:
    folder = tmp_path / "elasticity_1"
    folder.mkdir()
    (folder / "pretrained.json").write_text(document(1.782e5, (1.75e5, 1.79e5)))
    (folder / "analytic.json").write_text(document(None, None))
    page = estimation_page(tmp_path)
    for line in (
        "| truth | 180 | 0.13 |  |  |  |",
        "| guess | 50 | 0.02 |  |  |  |",
        "| the paper's | 184 | 0.2 |  |  |  |",
        "| analytic law | not told | 0.128 (0.12 to 0.14) | 1.0e-09 | 6 | 12 |",
        "| neural law | 178.2 (175 to 179) | 0.128 (0.12 to 0.14) | 1.0e-09 | 6 | 12 |",
        f"| neural law | 1 of 2 | E 1 %; {NU} 0.002 | E 2.2 %; {NU} 0.02 | 12 |",
        "| analytic law | 1 of 1, 1 not told |",
    ):
        assert line in page


def test_markers_that_know_no_truth_are_judged_by_what_the_others_know(tmp_path: Path) -> None:
    folder = tmp_path / "elasticity_1"
    folder.mkdir()
    markers = json.loads(document(1.79e5, (1.75e5, 1.85e5)))
    for one in markers["parameters"].values():
        del one["truth"]
    (folder / "markers.json").write_text(json.dumps(markers))
    with pytest.raises(UserError, match="elasticity_1: none of its results holds the truth"):
        estimation_page(tmp_path)
    (folder / "analytic.json").write_text(document(1.8e5, (1.79e5, 1.81e5)))
    assert "| analytic law, 100 markers | 2 of 2 |" in estimation_page(tmp_path)


def test_objects_searched_for_in_both_ways_are_drawn_beside_each_other(tmp_path: Path) -> None:
    for name, ways in (("elasticity_1", ("pretrained_unscreened", "adam")), ("elasticity_2", ("adam",))):
        (tmp_path / name).mkdir()
        for way in ways:
            values = json.loads(document(1.8e5, (1.7e5, 1.9e5)))
            values["history"] = [{"values": [5e4, 0.02], "mse": 1e-3}, {"values": [1.8e5, 0.128], "mse": 1e-9}]
            (tmp_path / name / f"{way}.json").write_text(json.dumps(values))
    searches = compared_searches(estimates(tmp_path))
    assert list(searches) == ["elasticity_1"]
    picture = searches_picture(searches, tmp_path / "searches.png")
    assert picture.stat().st_size > 1000
    assert "estimation_searches.png" in estimation_page(tmp_path)
    (tmp_path / "elasticity_1" / "adam.json").unlink()
    assert "estimation_searches.png" not in estimation_page(tmp_path)


def test_the_coverage_of_random_objects_is_counted(tmp_path: Path) -> None:
    folder = tmp_path / "elasticity_1"
    folder.mkdir()
    (folder / "analytic.json").write_text(document(1.8e5, (1.79e5, 1.81e5)))
    values = {"material": "sand", "projected": [[1e-5, 2e-5, 3e-5]] * 2, "covered_before": 5 / 6}
    (tmp_path / "coverage_sand.json").write_text(json.dumps(values))
    assert "| sand | 2 | 5 of 6 |" in estimation_page(tmp_path)


def test_a_folder_without_results_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="holds no results"):
        estimation_page(tmp_path)


def test_motions_of_other_grids_are_held_against_what_is_asked_for(tmp_path: Path) -> None:
    folder = tmp_path / "elasticity_1"
    folder.mkdir()
    (folder / "markers.json").write_text(document(1.8e5, (1.79e5, 1.81e5)))
    refined = json.loads(document(1.782e5, (1.75e5, 1.79e5)))
    refined["motion"] = {"grid_spacing": {"estimate": 0.0248}, "size": {"estimate": 0.051}}
    (folder / "refined.json").write_text(json.dumps(refined))
    refined["parameters"]["youngs_modulus"] |= {"estimate": 2e5, "interval_95": [1.6e5, 2.4e5]}
    (folder / "refined_third.json").write_text(json.dumps(refined))
    page = estimation_page(tmp_path)
    for line in (
        "| half the spacing, finer grids | 1 | 2 of 2 | 1 of 2 | 0 | 2 of 2 |",
        "| a third, finer grids | 1 | 1 of 2 | 2 of 2 | 0 | 1 of 2 |",
        "| half the spacing, finer grids | **-1.0 %, 2.0 times** | -0.002, 1.0 times |  | 2.48 of 2.50 | +5.1 % | 12 |",
        "| a third, finer grids | (+11.1 %), 40.0 times | -0.002, 1.0 times |  | 2.48 of 1.67 | +5.1 % | 12 |",
    ):
        assert line in page
