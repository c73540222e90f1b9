"""The pictures and tables of run time against error, from the result document alone."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullFormatter
from rich.table import Table

from benchmarks.charts import DPI, decorate, save, table_of

Row = Mapping[str, Any]
MARKERS = {1: "o", 2: "s", 3: "^", 4: "D"}
# Runs beside the sweep, drawn hollow with a letter.
VARIANTS = {"float64": "d", "no skips": "n", "torch": "t"}
FLOOR = ("drop", "bounce")
SIZE = 36.0
HELD = ("grid_nodes", "per_cell", "time_factor", "precision", "skips", "backend")


def draw(document: Mapping[str, Any], folder: Path) -> list[Path]:
    """One picture a material: a panel a problem, a row of panels a kind of law."""
    results = document["results"]
    paths = []
    for material in dict.fromkeys(row["material"] for row in results["rows"]):
        rows = [row for row in results["rows"] if row["material"] == material and row["error"]]
        problems, laws = (list(dict.fromkeys(row[key] for row in rows)) for key in ("problem", "law"))
        figure = Figure(figsize=(3.6 * len(problems) + 1.6, 3.3 * len(laws) + 0.4), dpi=DPI, layout="constrained")
        axes = figure.subplots(len(laws), len(problems), squeeze=False, sharex="col", sharey="col")
        for (i, law), (k, problem) in ((x, y) for x in enumerate(laws) for y in enumerate(problems)):
            _panel(axes[i, k], [row for row in rows if (row["law"], row["problem"]) == (law, problem)], results)
            axes[i, k].set_title(f"{problem}, {law} law" + ("s" if material != "elasticity" else ""), fontsize=9)
        _legend(figure, rows)
        title = f"{material}: run time against error, {document['provenance']['threads']} thread(s)"
        figure.suptitle(title, fontsize=10, x=0.01, ha="left")
        paths.append(save(figure, folder / f"{document['problem']}_{material}.png"))
    return paths


def pareto_front(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Those points (cost, error) that no other point beats in both, by growing cost."""
    front: list[tuple[float, float]] = []
    for cost, error in sorted(points):
        if not front or error < front[-1][1]:
            front.append((cost, error))
    return front


def tables(document: Mapping[str, Any]) -> list[Table]:
    """The presets and the automatic time step on the floor scenes, and the orders of convergence."""
    results = document["results"]
    automatic = [_automatic_table(results)] if results.get("automatic") else []
    return [_preset_table(results), *automatic, _order_table(results)]


def _panel(axis: Axes, rows: Sequence[Row], results: Mapping[str, Any]) -> None:
    for row in rows:
        variant = _variant(row)
        colour, marker = _colour(row["grid_nodes"]), MARKERS[row["per_cell"]]
        place = (row["seconds_per_simulated_second"], row["error"])
        if variant:
            axis.scatter(*place, SIZE, edgecolors=colour, facecolors="none", marker=marker, linewidths=0.8)
            axis.annotate(VARIANTS[variant], place, fontsize=5, ha="center", va="center", color=colour)
        else:
            size = SIZE * 0.5 * (1.0 + row["time_factor"])
            axis.scatter(*place, size, color=colour, marker=marker, alpha=0.8, linewidths=0.0)
    _front(axis, rows)
    _reference_line(axis, rows, results["references"])
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.xaxis.set_minor_formatter(NullFormatter())
    on_floor = bool(rows) and rows[0]["problem"] in FLOOR
    if on_floor:
        _preset_marks(axis, rows, results["presets"])
    decorate(axis, "seconds per simulated second", "error / size of the body" if on_floor else "error / displacement")


def _front(axis: Axes, rows: Sequence[Row]) -> None:
    front = pareto_front([(row["seconds_per_simulated_second"], row["error"]) for row in rows])
    if front:
        axis.plot(*zip(*front, strict=True), color="0.3", linewidth=1.0, zorder=0)


def _preset_marks(axis: Axes, rows: Sequence[Row], presets: Mapping[str, Row]) -> None:
    for name, row in _preset_rows(rows, presets).items():
        place = (row["seconds_per_simulated_second"], row["error"])
        axis.scatter(*place, 110.0, marker="*", color="black", zorder=3, linewidths=0.0)
        axis.annotate(name, place, xytext=(5, 5), textcoords="offset points", fontsize=7)


def _reference_line(axis: Axes, rows: Sequence[Row], references: Sequence[Row]) -> None:
    """Where the reference itself may be off: what lies below says little."""
    for reference in references:
        same = rows and all(reference[key] == rows[0][key] for key in ("problem", "material", "law"))
        if same and reference["estimated_error"]:
            axis.axhline(reference["estimated_error"], linestyle=":", color="0.5", linewidth=1.0)


def _legend(figure: Figure, rows: Sequence[Row]) -> None:
    def shown(label: str, marker: str, colour: str = "0.4", hollow: bool = False) -> Line2D:
        face = "none" if hollow else colour
        return Line2D([], [], linestyle="", marker=marker, color=colour, markerfacecolor=face, label=label)

    nodes, per_cell = (sorted({row[key] for row in rows}) for key in ("grid_nodes", "per_cell"))
    entries = [shown(f"{n} nodes", "o", _colour(n)) for n in nodes]
    entries += [shown(f"{n}³ particles a cell", MARKERS[n]) for n in per_cell]
    entries += [shown(f"{letter}: {name}", "o", hollow=True) for name, letter in VARIANTS.items()]
    entries += [
        shown("larger: longer time step", "o"),
        shown("preset", "*", "black"),
        Line2D([], [], color="0.3", linewidth=1.0, label="Pareto front"),
        Line2D([], [], color="0.5", linestyle=":", label="error of the reference"),
    ]
    figure.legend(handles=entries, loc="outside right center", fontsize=7, frameon=False)


def _variant(row: Row) -> str:
    """What sets a run apart from the sweep, '' for one of the sweep; the closed forms sweep in float64, too."""
    if not row["skips"]:
        return "no skips"
    if row["backend"] == "torch":
        return "torch"
    return "float64" if row["precision"] == "float64" else ""


def _colour(grid_nodes: int) -> str:
    return f"C{grid_nodes // 10 - 1}"


def _preset_rows(rows: Sequence[Row], presets: Mapping[str, Row]) -> dict[str, Row]:
    """The run of each preset among those of one problem, material and law."""
    found = {name: [row for row in rows if _same(row, preset)] for name, preset in presets.items()}
    return {name: runs[0] for name, runs in found.items() if runs}


def _same(row: Row, preset: Row) -> bool:
    return all(row[key] == preset[key] for key in HELD)


def _preset_table(results: Mapping[str, Any]) -> Table:
    table = table_of("presets", "", "nodes", "time step [s]", "particles", "s per simulated s", "error [% of size]")
    series = dict.fromkeys((row["problem"], row["material"], row["law"]) for row in results["rows"])
    for problem, material, law in series:
        rows = [
            row for row in results["rows"] if (row["problem"], row["material"], row["law"]) == (problem, material, law)
        ]
        for name, row in _preset_rows(rows, results["presets"]).items():
            if problem not in FLOOR or row["error"] is None:
                continue
            table.add_row(
                f"{name}: {problem}, {material}, {law}",
                str(row["grid_nodes"]),
                f"{row['time_step']:.4g}",
                str(row["particles"]),
                f"{row['seconds_per_simulated_second']:.3g}",
                f"{1e2 * row['error']:.2g}",
            )
    return table


def _automatic_table(results: Mapping[str, Any]) -> Table:
    """The automatic time step between the others at the same grid: what its error is made of."""
    table = table_of(
        "time_step=auto and others at its grid", "", "time step [s]", "s per simulated s", "error [% of size]"
    )
    for chosen in results["automatic"]:
        same = [
            row
            for row in results["rows"]
            if all(row[key] == chosen[key] for key in ("problem", "material", *HELD) if key != "time_factor")
            and row["error"] is not None
        ]
        for row in sorted(same, key=lambda row: (row["law"], row["time_factor"])):
            name = "auto: " if row["time_factor"] == chosen["time_factor"] else ""
            table.add_row(
                f"{name}{row['problem']}, {row['material']}, {row['law']}",
                f"{row['time_step']:.4g}",
                f"{row['seconds_per_simulated_second']:.3g}",
                f"{1e2 * row['error']:.2g}",
            )
    return table


def _is_shown(series: Row) -> bool:
    """Whether the table of orders shows a series: of the closed forms those of the paper's time step in float64."""
    return series["problem"] in FLOOR or (series["precision"], series["time_factor"]) == ("float64", 1.0)


def _order_table(results: Mapping[str, Any]) -> Table:
    table = table_of(
        "orders of convergence, time step proportional to grid spacing", "", "grid nodes", "errors", "orders"
    )
    for series in filter(_is_shown, results["orders"]):
        held = f"{series['per_cell']}³ a cell, time step x {series['time_factor']:g}, {series['precision']}"
        orders = ["-" if order is None else f"{order:.2f}" for order in series["orders"]]
        table.add_row(
            f"{series['problem']}, {series['material']}, {series['law']}: {held}",
            " ".join(map(str, series["grid_nodes"])),
            " ".join(f"{error:.2g}" for error in series["errors"]),
            " ".join(orders),
        )
    return table
