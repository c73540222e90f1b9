"""Pictures of the page of results, drawn from the JSON files alone."""

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import cycle
from pathlib import Path
from typing import NamedTuple

from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke
from matplotlib.ticker import LogLocator, NullLocator

from benchmarks.charts import COLOURS, chart, decorate, mark, panels, save
from benchmarks.pages.cells import title, words
from benchmarks.pages.documents import Document, Results, Row
from benchmarks.pages.material_tables import floor
from benchmarks.pages.published import PAPER_MATERIALS, PAPER_TASKS, paper_mse

MSE = "position error MSE [m²]"
BAR, GROUP = 0.86, 5.4  # height of a bar and distance of two tasks, in bars
LABEL_GAP = 0.055  # distance of two labels over the height of the axis
ROOM_FOR_NUMBERS = 12.0  # the axis ends at so many times the largest error


class _Series(NamedTuple):
    """One bar of each task: our row, or the paper's of the same kind."""

    label: str
    row: str
    ours: bool
    colour: str


SERIES = (
    _Series("ours -M", "multi", True, "tab:blue"),
    _Series("paper -M", "multi", False, "0.62"),
    _Series("ours -S", "single", True, "#6baed6"),
    _Series("paper -S", "single", False, "0.78"),
)


def draw_accuracy(results: Results, path: Path) -> Path | None:
    """Our errors beside the paper's on its four tasks, one panel a material; None without any of ours."""
    shown = {name: rows for name in PAPER_MATERIALS if (rows := results.get(name)) and _has_bars(rows)}
    if not shown:
        return None
    bars = {name: _bars(name, rows) for name, rows in shown.items()}
    values = [value for some in bars.values() for value in some.values() if value]
    figure, axes = panels(len(shown), width=2.0 + 3.4 * len(shown), height=5.4)
    for axis, (name, rows) in zip(axes, shown.items(), strict=True):
        _draw_bars(axis, bars[name], rows, _power_below(values))
        axis.set_xlim(_power_below(values), ROOM_FOR_NUMBERS * max(values))
        axis.set_title(title(name), fontsize=11)
    _name_bars(axes[0])
    for axis in axes[1:]:
        axis.set_yticks([])
    figure.supxlabel(
        "black marks: the analytic law itself with half the time step. The paper's errors are of its own engine, "
        "motions and training scenes.",
        fontsize=8,
        color="0.35",
    )
    return save(figure, path)


def draw_training_scenes(found: Mapping[str, Mapping[int, Document]], path: Path) -> Path | None:
    """Error on `unseen` against the number of training scenes, a line a material; None without any."""
    if not found:
        return None
    figure, axis = chart()
    ends: dict[str, tuple[int, float]] = {}
    colours = dict(zip(found, cycle(COLOURS), strict=False))
    for material, known in found.items():
        points = [(count, document["mse"]) for count, document in known.items() if document["mse"]]
        if points:
            axis.plot(*zip(*points, strict=True), "o-", color=colours[material], markersize=5)
            ends[material] = points[-1]
    axis.set_yscale("log")
    mark(axis, sorted({count for known in found.values() for count in known}))
    axis.margins(x=0.2)
    heights = _apart(axis, [mse for _, mse in ends.values()])
    for (material, (count, _)), height in zip(ends.items(), heights, strict=True):
        axis.text(1.07 * count, height, words(material), va="center", fontsize=9, color=colours[material])
    decorate(axis, "training scenes", f"{MSE}, unseen objects")
    return save(figure, path)


def _apart(axis: Axes, heights: Sequence[float]) -> list[float]:
    """Heights of labels on a logarithmic axis: those given, moved up where they would lie on each other."""
    low, high = axis.get_ylim()
    gap = (high / low) ** LABEL_GAP
    found: dict[int, float] = {}
    lowest = low
    for place in sorted(range(len(heights)), key=lambda place: heights[place]):
        found[place] = max(heights[place], lowest)
        lowest = found[place] * gap
    return [found[place] for place in range(len(heights))]


def _has_bars(rows: Mapping[str, Row]) -> bool:
    return any(task in rows[row].tasks for row in ("multi", "single") if row in rows for task in PAPER_TASKS)


def _bars(material: str, rows: Mapping[str, Row]) -> dict[tuple[int, int], float | None]:
    """Error by place of task and series; None of an evaluation that diverged, absent where there is none."""
    found: dict[tuple[int, int], float | None] = {}
    for number, task in enumerate(PAPER_TASKS):
        for place, series in enumerate(SERIES):
            if not series.ours:
                value = paper_mse(material, series.row, task)
                found |= {(number, place): value} if value else {}
            elif series.row in rows and task in rows[series.row].tasks:
                found[number, place] = rows[series.row].tasks[task]["mse"]
    return found


def _draw_bars(axis: Axes, bars: Mapping[tuple[int, int], float | None], rows: Mapping[str, Row], start: float) -> None:
    axis.set_xscale("log")
    for (number, place), value in bars.items():
        height, series = _height(number, place), SERIES[place]
        if value:
            axis.barh(height, value - start, BAR, left=start, color=series.colour)
        text = "diverged" if value is None else f"{value:.1e}"
        weight = "bold" if series.ours else "normal"
        label = axis.annotate(
            text, (value or start, height), (3, 0), textcoords="offset points", va="center", fontsize=7.5, weight=weight
        )
        label.set_path_effects([withStroke(linewidth=3.0, foreground="white")])
    for number, task in enumerate(PAPER_TASKS):
        limit = floor(rows, task, "half_step")
        if limit and limit > start:
            axis.plot((limit, limit), (_height(number, -0.5), _height(number, len(SERIES) - 0.5)), "k-", linewidth=1.4)
    axis.set_ylim(_height(len(PAPER_TASKS) - 1, float(len(SERIES))), _height(0, -1.6))
    decorate(axis, MSE, "")
    axis.grid(False, axis="y")
    axis.xaxis.set_major_locator(LogLocator(numticks=6))
    axis.xaxis.set_minor_locator(NullLocator())
    axis.tick_params(axis="y", length=0)


def _name_bars(axis: Axes) -> None:
    """The names of the tasks and of the bars, on the left of the first panel."""
    names = {_height(number, -0.95): words(task) for number, task in enumerate(PAPER_TASKS)}
    labels = {
        _height(number, place): series.label
        for number in range(len(PAPER_TASKS))
        for place, series in enumerate(SERIES)
    }
    axis.set_yticks([*names, *labels], [*names.values(), *labels.values()], fontsize=8)
    for label in axis.get_yticklabels()[: len(names)]:
        label.set(weight="bold", fontsize=9)


def _height(number: int, place: int | float) -> float:
    """Where a bar lies; the first task is at the top."""
    return -(number * GROUP + place)


def _power_below(values: Iterable[float]) -> float:
    return 10.0 ** math.floor(math.log10(min(values)) - 0.3)
