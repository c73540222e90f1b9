"""The pictures of an evaluation."""

from collections.abc import Sequence
from pathlib import Path

from pcnclaws.evaluation.parameter_map import error_maps
from pcnclaws.evaluation.report import Outcomes, survived
from pcnclaws.evaluation.tasks import SceneResult
from pcnclaws.laws.materials import Material
from pcnclaws.rendering.animation import animation
from pcnclaws.rendering.comparison_sheet import Pair, comparison_sheet
from pcnclaws.rendering.curves import ErrorCurve, error_over_time
from pcnclaws.rendering.maps import error_map
from pcnclaws.rendering.pictures import predicted_beside_true

MOST_SHEETS = 6


def leave_pictures(
    results: Sequence[SceneResult], folder: Path, stem: str, before: Sequence[SceneResult] = (), animated: bool = True
) -> list[Path]:
    """Pictures of the results: predicted beside true for each scene, error over time, and one animation.

    before   the same scenes before training, for the error over time
    returns  <folder>/<stem>_<scene>.png (of the first scenes), <stem>_error_over_time.png, <stem>_<first scene>.gif
    """
    sheets = [
        predicted_beside_true(result.true, result.predicted, folder / f"{stem}_{_safe(result.name)}.png")
        for result in results[:MOST_SHEETS]
    ]
    curves = error_over_time(_curves(results), folder / f"{stem}_error_over_time.png", _curves(before))
    if not animated:
        return [*sheets, curves]
    first = results[0]
    return [*sheets, curves, animation(first.true, first.predicted, folder / f"{stem}_{_safe(first.name)}.gif")]


def leave_sheet(results: Sequence[SceneResult], title: str, folder: Path, stem: str) -> list[Path]:
    """Pictures of a built-in task: its scenes on one sheet, error over time, and an animation of the worst scene.

    returns  <folder>/<stem>_sheet.png, <stem>_error_over_time.png, <stem>.gif
    """
    worst = max(results, key=lambda result: result.mse)
    return [
        _sheet(results, title, folder, stem),
        error_over_time(_curves(results), folder / f"{stem}_error_over_time.png"),
        animation(worst.true, worst.predicted, folder / f"{stem}.gif"),
    ]


def leave_map(outcomes: Outcomes, material: Material, title: str, folder: Path, stem: str) -> list[Path]:
    """Pictures of the map of parameters: the errors of all its scenes, and the worst scenes, true and predicted.

    returns  <folder>/<stem>_map.png, <stem>_sheet.png
    """
    mse: dict[str, float | None] = dict.fromkeys(outcome.name for outcome in outcomes)
    results = survived(outcomes)
    mse |= {result.name: result.mse for result in results}
    pictures = [error_map(error_maps(material, mse), folder / f"{stem}_map.png", title)]
    return [*pictures, _sheet(results, title, folder, stem)] if results else pictures


def _sheet(results: Sequence[SceneResult], title: str, folder: Path, stem: str) -> Path:
    """Of more scenes than a sheet shows, those with the largest errors."""
    shown = results
    if len(results) > MOST_SHEETS:
        least = sorted((result.mse for result in results), reverse=True)[MOST_SHEETS - 1]
        shown = [result for result in results if result.mse >= least][:MOST_SHEETS]
        title = f"{title}: of {len(results)} scenes the {MOST_SHEETS} with the largest errors"
    return comparison_sheet([Pair(one.true, one.predicted) for one in shown], folder / f"{stem}_sheet.png", title)


def _curves(results: Sequence[SceneResult]) -> list[ErrorCurve]:
    return [ErrorCurve(result.name, result.time, result.mse_by_frame) for result in results]


def _safe(name: str) -> str:
    """The name of a scene as a part of a file name."""
    return "".join(letter if letter.isascii() and (letter.isalnum() or letter in "._-") else "_" for letter in name)
