"""The look that all pictures and tables of the benchmarks share."""

import math
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import TABLEAU_COLORS
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator
from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table

from pcnclaws.atomic import replaced_file

DPI = 150
COLOURS = tuple(TABLEAU_COLORS.values())


def chart(width: float = 6.4, height: float = 3.8) -> tuple[Figure, Axes]:
    """A figure of one panel, in inches."""
    figure = Figure(figsize=(width, height), dpi=DPI, layout="constrained")
    return figure, figure.subplots()


def panels(count: int, width: float = 10.0, height: float = 3.6) -> tuple[Figure, list[Axes]]:
    """A figure of panels side by side, in inches."""
    figure = Figure(figsize=(width, height), dpi=DPI, layout="constrained")
    return figure, list(np.atleast_1d(figure.subplots(1, count)))


def decorate(axis: Axes, horizontal: str, vertical: str) -> None:
    """Labels of both axes, a light grid, no frame on the right and on top."""
    axis.set_xlabel(horizontal)
    axis.set_ylabel(vertical)
    axis.grid(True, which="major", color="0.9")
    axis.set_axisbelow(True)
    axis.spines[["top", "right"]].set_visible(False)


def axis_floor(costs: Iterable[float]) -> float:
    """Power of ten below all costs: where bars on a logarithmic axis begin."""
    return 10.0 ** (math.ceil(math.log10(min(costs))) - 1)


def mark(axis: Axes, places: Sequence[float | int]) -> None:
    """Ticks of a logarithmic horizontal axis at these places alone."""
    axis.set_xscale("log")
    axis.set_xticks(list(places), [f"{place:,.0f}".replace(",", " ") for place in places])
    axis.xaxis.set_minor_locator(NullLocator())


def save(figure: Figure, path: Path) -> Path:
    """Writes the figure as PNG, whole or not at all."""
    with replaced_file(path) as unfinished:
        figure.savefig(unfinished, format="png", dpi=DPI)
    return path


def table_of(title: str, text: str, *numbers: str) -> Table:
    """An empty table: a column of text, then columns of numbers."""
    table = Table(title=escape(title), title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.add_column(escape(text), overflow="fold")
    for header in numbers:
        table.add_column(escape(header), justify="right")
    return table
