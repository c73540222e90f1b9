"""All scenes of a data set on one sheet."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from pcnclaws.atomic import replaced_file
from pcnclaws.rendering.labels import material_label
from pcnclaws.rendering.panels import camera_for, panel
from pcnclaws.simulation.records import SceneRecord

COLUMNS, TILE_WIDTH, DPI = 4, 260, 130
MAXIMUM_TILES = 48


def contact_sheet(records: Sequence[SceneRecord], path: Path) -> Path:
    """One tile for each scene, as it ends; how it started is written below.

    Of a large data set the first MAXIMUM_TILES scenes are shown.
    """
    shown = list(records)[:MAXIMUM_TILES]
    camera = camera_for(shown, TILE_WIDTH)
    columns = min(COLUMNS, len(shown))
    rows = math.ceil(len(shown) / columns)
    size = (columns * (camera.width / DPI + 0.15), rows * (camera.height / DPI + 0.55))
    figure = Figure(figsize=size, dpi=DPI, layout="constrained")
    for axis in (axes := figure.subplots(rows, columns, squeeze=False).flatten()):
        axis.axis("off")
    for axis, record in zip(axes, shown, strict=False):
        axis.imshow(panel(record, len(record.time) - 1, camera), interpolation="antialiased")
        axis.set_title(_caption(record), fontsize=6.5)
    with replaced_file(path) as unfinished:
        figure.savefig(unfinished, format=path.suffix[1:], dpi=DPI)
    return path


def _caption(record: SceneRecord) -> str:
    """Name, parameters, and how the scene started."""
    caption = f"{record.name}\n{material_label(record.material, record.parameters)}"
    if record.initial_velocity is None:
        return caption
    velocity = record.initial_velocity.mean(0)
    spins = bool(np.ptp(record.initial_velocity, axis=0).max() > 1e-4)
    return f"{caption}\nthrown at {np.linalg.norm(velocity):.1f} m/s{', spinning' if spins else ''}"
