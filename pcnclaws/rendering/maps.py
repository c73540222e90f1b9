"""Maps of the error over pairs of physical parameters."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from pcnclaws.atomic import replaced_file
from pcnclaws.rendering.labels import axis_label

COLOURS, TRAINED = colormaps["viridis_r"], "crimson"
PANEL, DPI = 3.1, 150  # inches, pixels an inch
NO_ERROR = (1e-12, 1e-2)  # ends of the scale where no error is above zero
DIVERGED = {"facecolor": "0.92", "edgecolor": "0.45", "hatch": "////", "linewidth": 0.0}


class MapAxis(NamedTuple):
    """One axis of a map.

    name       of the parameter
    values     where the points lie
    geometric  whether they grow by a factor
    trained    range of the training data
    """

    name: str
    values: Float[np.ndarray, " points"]
    geometric: bool
    trained: tuple[float, float]


class ErrorMap(NamedTuple):
    """The error over two parameters.

    mse  [m^2], (values up, values across), NaN where the scene diverged
    """

    across: MapAxis
    up: MapAxis
    mse: Float[np.ndarray, "up across"]


def error_map(maps: Sequence[ErrorMap], path: Path, title: str = "") -> Path:
    """The maps side by side in one scale of colours; a box around the ranges of the training data.

    returns  the path, whose suffix (.png, .pdf, .svg) chooses the format
    """
    figure = Figure(figsize=(PANEL * len(maps) + 0.9, PANEL + 0.75), dpi=DPI, layout="constrained")
    axes = figure.subplots(1, len(maps), squeeze=False)[0]
    scale = _scale(maps)
    for axis, one in zip(axes, maps, strict=True):
        _draw(axis, one, scale)
    bar = figure.colorbar(ScalarMappable(scale, COLOURS), ax=list(axes), fraction=0.05, pad=0.01)
    some = any((one.mse > 0.0).any() for one in maps)
    bar.set_label("position error MSE [m²]" if some else "no error in any scene", fontsize=8)
    bar.ax.tick_params(labelsize=7)
    handles = [Patch(fill=False, edgecolor=TRAINED, label="range of the training data")]
    if any(np.isnan(one.mse).any() for one in maps):
        handles.append(Patch(label="diverged", **DIVERGED))
    figure.legend(handles=handles, loc="outside lower center", ncols=2, fontsize=8, frameon=False)
    if title:
        figure.suptitle(title, fontsize=9)
    with replaced_file(path) as unfinished:
        figure.savefig(unfinished, format=path.suffix[1:], dpi=DPI)
    return path


def cell_edges(axis: MapAxis) -> Float[np.ndarray, " edges"]:
    """Edges of cells around the points of an axis: halfway between them, by factor where the axis is geometric."""
    places = np.log(axis.values) if axis.geometric else axis.values
    middles = 0.5 * (places[1:] + places[:-1])
    edges = np.concatenate(([2.0 * places[0] - middles[0]], middles, [2.0 * places[-1] - middles[-1]]))
    return np.exp(edges) if axis.geometric else edges


def _scale(maps: Sequence[ErrorMap]) -> LogNorm:
    """From the smallest error above zero to the largest; no error at all has the colour of the lower end."""
    errors = np.concatenate([one.mse.ravel() for one in maps])
    positive = errors[np.isfinite(errors) & (errors > 0.0)]
    low, high = (float(positive.min()), float(positive.max())) if len(positive) else NO_ERROR
    return LogNorm(low, max(high, 10.0 * low), clip=True)


def _draw(picture: Axes, one: ErrorMap, scale: LogNorm) -> None:
    across, up = cell_edges(one.across), cell_edges(one.up)
    picture.add_patch(Rectangle((across[0], up[0]), across[-1] - across[0], up[-1] - up[0], **DIVERGED))
    shown = np.ma.masked_invalid(np.clip(one.mse, scale.vmin, None))
    picture.pcolormesh(across, up, shown, norm=scale, cmap=COLOURS, edgecolors="white", linewidth=0.4)
    (left, right), (low, high) = one.across.trained, one.up.trained
    picture.add_patch(Rectangle((left, low), right - left, high - low, fill=False, edgecolor=TRAINED, linewidth=1.6))
    picture.set(xscale=_kind(one.across), yscale=_kind(one.up))
    for side, axis in ((picture.xaxis, one.across), (picture.yaxis, one.up)):
        label, factor = axis_label(axis.name)
        side.set_major_locator(FixedLocator(axis.values.tolist()))
        side.set_minor_locator(NullLocator())
        side.set_major_formatter(FuncFormatter(lambda value, _, factor=factor: f"{value * factor:.4g}"))
        side.set_label_text(label, fontsize=8)
    picture.tick_params(labelsize=7)
    picture.set(xlim=(across[0], across[-1]), ylim=(up[0], up[-1]))


def _kind(axis: MapAxis) -> str:
    return "log" if axis.geometric else "linear"
