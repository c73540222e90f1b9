"""The tables and the picture of the cost of a step."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from rich.table import Table

from benchmarks import step_cost_on_gpu
from benchmarks.charts import COLOURS, axis_floor, chart, decorate, save, table_of

UNIT = "T/1000 per 1000 particles and step"
BAR = 0.84
PALE = 0.45


def tables(document: Mapping[str, Any]) -> list[Table]:
    """Cost of every row with its bounds, and the peak memory."""
    results = document["results"]
    if on_gpu(document):
        return [step_cost_on_gpu.table(results["rows"])]
    table = table_of(
        "cost of a step per 1000 particles",
        "",
        *("backend", "scenes", "particles", "ms", "median", "T [ms]", "T/1000", "at most", "aim", "of batch"),
    )
    batches = _batch_costs(results["rows"])
    for row in results["rows"]:
        cost, time = row["cost"], row["ms_per_1000"]
        batch = batches[row["kind"], row["backend"]] if _is_small(row) else None
        table.add_row(
            f"{row['kind']} {row['words']}",
            row["backend"],
            str(row["scenes"]),
            str(row["particles"]),
            f"{time['min']:.3g}",
            f"{time['median']:.3g}",
            f"{row['matmul_ms']['min']:.0f}",
            f"{cost:.3g}",
            f"{row['at_most']:.3g}",
            f"{row['aim']:.3g}",
            f"{cost / batch:.2f}" if batch else "",
        )
    return [table, *(_extra_table(part, results[part]) for part in ("memory", "first_call") if results[part])]


def draw(document: Mapping[str, Any], folder: Path) -> list[Path]:
    """Bars of the cost of each kind of step, by implementation, beside other engines and the bounds."""
    results = document["results"]
    if on_gpu(document):
        return step_cost_on_gpu.draw(document, folder)
    groups = _groups(results)
    figure, axis = chart(width=11.0, height=4.4)
    series = list(dict.fromkeys(name for bars in groups.values() for name in bars))
    width = BAR / len(series)
    for number, name in enumerate(series):
        places = [k + (number + 0.5) * width - BAR / 2 for k, bars in enumerate(groups.values()) if name in bars]
        heights = [bars[name] for bars in groups.values() if name in bars]
        strength = 1.0 if name.startswith("pcnclaws") else PALE
        axis.bar(places, heights, width, color=COLOURS[number % len(COLOURS)], alpha=strength, label=name)
    _bounds(axis, results["rows"], list(groups))
    axis.set_yscale("log")
    axis.set_ylim(bottom=axis_floor(cost for bars in groups.values() for cost in bars.values()))
    axis.set_xticks(range(len(groups)), [name.replace(", ", "\n") for name in groups], fontsize=8)
    decorate(axis, "", UNIT)
    axis.grid(False, axis="x")
    axis.legend(fontsize=7, frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    kinds = {row["kind"]: row["words"] for row in results["rows"]}
    note = (
        f"{'; '.join(f'{kind}: {words}' for kind, words in kinds.items())}\npale bars: {results['references']['note']}"
    )
    figure.supxlabel(note, fontsize=7, color="0.4")
    return [save(figure, folder / f"{document['problem']}.png")]


def on_gpu(document: Mapping[str, Any]) -> bool:
    """Whether a GPU was measured, for which the bounds and the other engines' costs do not hold."""
    return document["provenance"]["device"] != "cpu"


def _groups(results: Mapping[str, Any]) -> dict[str, dict[str, float]]:
    """Group of bars -> series -> cost; other engines stand with the rows that they were measured for."""
    groups: dict[str, dict[str, float]] = {}
    for row in results["rows"]:
        bars = groups.setdefault(_group(row), {})
        bars[f"pcnclaws, {row['backend']}"] = row["cost"]
    for engine, costs in results["references"].items():
        for name, bars in groups.items():
            key = name.partition(",")[0]
            if isinstance(costs, Mapping) and key in costs and not name.endswith("1 scene"):
                bars[engine] = costs[key]
    return groups


def _group(row: Mapping[str, Any]) -> str:
    """'A, 8 scenes', 'A, 1 scene', or 'A 8000, one body' for a larger body."""
    if row["scenes"] == 1 and row["particles"] > 1000:
        return f"{row['kind']} {row['particles']}, one body"
    return f"{row['kind']}, {row['scenes']} scene{'s' if row['scenes'] > 1 else ''}"


def _is_small(row: Mapping[str, Any]) -> bool:
    """Whether it is one scene of the paper."""
    return row["scenes"] == 1 and row["particles"] == 1000


def _batch_costs(rows: Sequence[Mapping[str, Any]]) -> dict[tuple[str, str], float]:
    """Cost of the largest batch of scenes, by kind and implementation."""
    batches = sorted((row for row in rows if row["scenes"] > 1), key=lambda row: row["scenes"])
    ones = [row for row in rows if _is_small(row)]
    return {(row["kind"], row["backend"]): row["cost"] for row in (*ones, *batches)}


def _bounds(axis: Axes, rows: Sequence[Mapping[str, Any]], groups: Sequence[str]) -> None:
    """A line across each group at what it may cost, a dotted one at the aim."""
    bounds = {_group(row): row for row in rows}
    for number, name in enumerate(groups):
        ends = (number - BAR / 2, number + BAR / 2)
        for key, style in (("at_most", "-"), ("aim", ":")):
            height = bounds[name][key]
            label = key.replace("_", " ") if number == 0 else None
            axis.plot(ends, (height, height), style, color="black", linewidth=1.2, label=label)


def _extra_table(part: str, rows: Sequence[Mapping[str, Any]]) -> Table:
    """Peak memory of D, or time of the first call."""
    if part == "first_call":
        title = "first call of a process: with an empty cache of compiled kernels, and with a full one"
        table = table_of(title, "backend", "cold [s]", "warm [s]", "cold at most")
        for row in rows:
            table.add_row(row["backend"], *(f"{row[f'{name}_seconds']:.1f}" for name in ("cold", "warm", "at_most")))
        return table
    table = table_of(
        "peak memory of D above the imported library, one scene", "backend", "steps", "peak [MB]", "at most"
    )
    for row in rows:
        peak = "not measured" if row["peak"] is None else f"{row['peak']['above_mb']:.0f}"
        table.add_row(row["backend"], str(row["steps"]), peak, f"{row['at_most_mb']:.0f}")
    return table
