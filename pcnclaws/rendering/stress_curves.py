"""Measured and predicted stress over the deformation, a panel a specimen."""

from collections.abc import Mapping, Sequence
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import TABLEAU_COLORS
from matplotlib.figure import Figure

from pcnclaws.atomic import replaced_file

DPI, COLUMNS, PANEL = 110, 4, (3.6, 3.0)
COLOURS = tuple(TABLEAU_COLORS.values())
# Pa of a unit, by the largest stress that it is for.
SHOWN_UNITS = (("MPa", 1e6), ("kPa", 1e3), ("Pa", 1.0))


def draw_stress_curves(rows: Sequence[Mapping[str, Any]], path: Path) -> Path:
    """Draws the loading paths of metrics.json: points were measured, lines predicted, dashed where left out."""
    specimens = list(dict.fromkeys(row["specimen"] for row in rows))
    columns = min(COLUMNS, len(specimens))
    lines = ceil(len(specimens) / columns)
    figure = Figure(figsize=(PANEL[0] * columns + 0.4, PANEL[1] * lines + 0.6), dpi=DPI, layout="constrained")
    axes = np.asarray(figure.subplots(lines, columns, squeeze=False)).ravel()
    for axis, specimen in zip(axes, specimens, strict=False):
        _draw(axis, [row for row in rows if row["specimen"] == specimen])
        axis.set_title(specimen.replace("_", " "), fontsize=9)
    for axis in axes[len(specimens) :]:
        axis.set_axis_off()
    figure.suptitle("points: measured; lines: predicted (dashed: left out of training)", fontsize=9)
    with replaced_file(path) as part:
        figure.savefig(part, format="png")
    return path


def _draw(axis: Axes, rows: Sequence[Mapping[str, Any]]) -> None:
    largest = max(abs(value) for row in rows for curve in row["curves"] for value in curve["measured"])
    unit, factor = next((unit for unit in SHOWN_UNITS if largest >= unit[1]), SHOWN_UNITS[-1])
    for number, row in enumerate(rows):
        colour = COLOURS[number % len(COLOURS)]
        for which, curve in enumerate(row["curves"]):
            order = np.argsort(curve["at"])
            at, measured, predicted = (np.array(curve[name])[order] for name in ("at", "measured", "predicted"))
            axis.plot(at, measured / factor, "o" if which == 0 else "x", color=colour, markersize=2.5, alpha=0.5)
            label = row["name"].rpartition("/")[2] if which == 0 else None
            style = "-" if row["trained"] else "--"
            axis.plot(at, predicted / factor, style, color=colour, linewidth=1.2, label=label)
    shear = all(curve["deformation"][1] != curve["deformation"][2] for row in rows for curve in row["curves"])
    axis.set_xlabel("shear" if shear else "stretch or shear", fontsize=8)
    axis.set_ylabel(f"stress [{unit}]", fontsize=8)
    axis.tick_params(labelsize=7)
    axis.legend(fontsize=5.5, frameon=False)
