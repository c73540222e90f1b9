"""Sheets: figures with a grid of pictures."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pcnclaws.atomic import replaced_file
from pcnclaws.rendering.camera import Camera
from pcnclaws.simulation.records import SceneRecord

DPI = 150


def spread(record: SceneRecord, times: int) -> np.ndarray:
    """Indices of evenly spread frames, the first and the last among them."""
    count = len(record.time)
    return np.rint(np.linspace(0, count - 1, min(times, count))).astype(int)


def time_label(record: SceneRecord, frame: int) -> str:
    """Time since the first frame."""
    return f"{record.time[frame] - record.time[0]:.3f} s"


def sheet_of(rows: int, columns: int, camera: Camera) -> tuple[Figure, np.ndarray]:
    """Empty figure with a grid of axes, (rows, columns), sized for pictures of the camera."""
    width, height = camera.width / DPI, camera.height / DPI
    figure = Figure(figsize=(columns * width + 1.1, rows * height + 0.65), dpi=DPI, layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False)


def show(axis: Axes, picture: np.ndarray) -> None:
    """Puts a picture alone on an axis."""
    axis.imshow(picture, interpolation="antialiased")
    axis.set_xticks([])
    axis.set_yticks([])
    for spine in axis.spines.values():
        spine.set_visible(False)


def save_figure(figure: Figure, path: Path) -> Path:
    """Writes a figure, whole or not at all, in the format of the ending."""
    with replaced_file(path) as unfinished:
        figure.savefig(unfinished, format=path.suffix[1:], dpi=DPI)
    return path
