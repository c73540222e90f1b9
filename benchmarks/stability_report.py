"""The picture and the table of the survival map, from the result document alone."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from rich.table import Table

from benchmarks.charts import DPI, save, table_of
from benchmarks.stability_limits import STABLE, is_crushed, limit_of

DIVERGED = "d"
# What the colours say of all bodies of a field of the map, by growing trouble.
KINDS = ("all stable", "some gain energy", "some diverge", "all diverge", "crushed")
SHADES = ("#2a788e", "#b8de29", "#f8a255", "#b63679", "#cccccc")


def draw(document: Mapping[str, Any], folder: Path) -> list[Path]:
    """A panel a material and stiffness: CFL number over Poisson's ratio, with the predicted and the used limit."""
    results = document["results"]
    materials, moduli = list(dict.fromkeys(row["material"] for row in results["rows"])), results["youngs_modulus"]
    figure = Figure(figsize=(2.6 * len(moduli) + 2.2, 2.4 * len(materials) + 0.5), dpi=DPI, layout="constrained")
    axes = figure.subplots(len(materials), len(moduli), squeeze=False, sharex=True, sharey=True)
    for i, material in enumerate(materials):
        rows = [row for row in results["rows"] if row["material"] == material]
        for k, modulus in enumerate(moduli):
            _map(axes[i, k], kinds_of(rows, results, k))
            _lines(axes[i, k], results, material)
            axes[i, k].set_title(f"{material}, E = {modulus:.0e} Pa", fontsize=8)
            _ticks(axes[i, k], results)
    figure.supxlabel("Poisson's ratio", fontsize=9)
    figure.supylabel("CFL number", fontsize=9)
    _legend(figure, axes[0, 0])
    return [save(figure, folder / f"{document['problem']}.png")]


def tables(document: Mapping[str, Any]) -> list[Table]:
    """The limits by material and Poisson's ratio, beside the prediction."""
    results = document["results"]
    table = table_of("largest stable CFL number", "nu", "one particle alone", *results["limits"])
    for k, ratio in enumerate(results["poissons_ratio"]):
        found = (
            dict(zip(limits["poissons_ratio"], limits["cfl"], strict=True)) for limits in results["limits"].values()
        )
        measured = (f"{limit[ratio]:g}" if ratio in limit else "-" for limit in found)
        table.add_row(f"{ratio:g}", f"{results['single_particle'][k]:.2f}", *measured)
    return [table]


def kinds_of(rows: Sequence[Mapping[str, Any]], results: Mapping[str, Any], modulus: int) -> np.ndarray:
    """Number into KINDS of every field of a panel, (CFL numbers, Poisson's ratios)."""
    ratios, levels = range(len(results["poissons_ratio"])), sorted(results["cfl"])
    kinds = np.zeros((len(levels), len(ratios)), dtype=int)
    for k in ratios:
        limits = [limit_of(rows, number, k) for number in range(len(results["youngs_modulus"]))]
        crushed = is_crushed(modulus, limits, results["youngs_modulus"])
        for i, level in enumerate(levels):
            fates = "".join(row["fates"][modulus][k] for row in rows if row["cfl"] == level)
            kinds[i, k] = 4 if crushed else _kind(fates)
    return kinds


def _kind(fates: str) -> int:
    diverged = fates.count(DIVERGED)
    if diverged:
        return 3 if diverged == len(fates) else 2
    return 0 if fates == STABLE * len(fates) else 1


def _map(axis: Axes, kinds: np.ndarray) -> None:
    norm = BoundaryNorm(np.arange(len(KINDS) + 1) - 0.5, len(KINDS))
    axis.pcolormesh(kinds, cmap=ListedColormap(SHADES), norm=norm, edgecolors="white", linewidth=0.3)


def _lines(axis: Axes, results: Mapping[str, Any], material: str) -> None:
    levels = sorted(results["cfl"])
    middles = np.arange(len(results["poissons_ratio"])) + 0.5
    axis.plot(middles, _rows(levels, results["single_particle"]), "k--", linewidth=1.2, label="one particle alone")
    axis.axhline(float(_rows(levels, [1.0])[0]), color="black", linestyle=":", linewidth=1.2, label="CFL number 1")
    limits = results["limits"][material]
    where = [results["poissons_ratio"].index(ratio) for ratio in limits["poissons_ratio"]]
    # the upper edge of the last stable level
    edges = [levels.index(limit) + 1.0 for limit in limits["cfl"]]
    axis.step([0.5 + k for k in where], edges, where="mid", color="red", linewidth=1.6, label="measured limit")


def _rows(levels: Sequence[float], values: Sequence[float]) -> np.ndarray:
    """Where CFL numbers lie on the vertical axis, whose fields are of equal height."""
    return np.interp(values, levels, np.arange(len(levels)) + 0.5)


def _ticks(axis: Axes, results: Mapping[str, Any]) -> None:
    levels, ratios = sorted(results["cfl"]), results["poissons_ratio"]
    axis.set_xticks(np.arange(len(ratios)) + 0.5, [f"{ratio:g}" for ratio in ratios], fontsize=6, rotation=90)
    axis.set_yticks(np.arange(len(levels)) + 0.5, [f"{level:g}" for level in levels], fontsize=6)


def _legend(figure: Figure, axis: Axes) -> None:
    patches = [Patch(color=shade, label=kind) for kind, shade in zip(KINDS, SHADES, strict=True)]
    figure.legend(
        handles=[*patches, *axis.get_legend_handles_labels()[0]], loc="outside right upper", fontsize=7, frameon=False
    )
