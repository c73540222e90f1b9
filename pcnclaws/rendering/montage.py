"""Montages: motions drawn by one camera, side by side or in one panel; a sheet of their times."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from pcnclaws.rendering.camera import Camera
from pcnclaws.rendering.colouring import Colouring
from pcnclaws.rendering.labels import material_colour, material_label
from pcnclaws.rendering.panels import Part, panel_of
from pcnclaws.rendering.sheets import save_figure, sheet_of, show
from pcnclaws.rendering.spheres import Shade
from pcnclaws.simulation.records import SceneRecord


@dataclass(frozen=True)
class Montage:
    """Motions in one picture, each where it is at a time since its first frame.

    names       what the motions are called
    colouring   None: the colours of their materials
    overlaid    whether they share a panel
    oversample  as of draw_particles
    shade       as of draw_particles
    """

    records: Sequence[SceneRecord]
    names: Sequence[str]
    camera: Camera
    colouring: Colouring | None = None
    overlaid: bool = False
    oversample: int = 2
    shade: Shade | None = None

    @property
    def title(self) -> str:
        """Material and parameters of the first motion."""
        return material_label(self.records[0].material, self.records[0].parameters)

    @property
    def rows(self) -> Sequence[str]:
        """What the panels are called."""
        return [" + ".join(self.names)] if self.overlaid else self.names

    @property
    def legend(self) -> list[tuple[str, tuple[float, float, float]]]:
        """Names and colours of motions that share a panel, where each has a colour of its own; otherwise empty."""
        if not self.overlaid or self.colouring is None or self.colouring.scale is not None:
            return []
        given = [self.colouring.at(number, 0) for number in range(len(self.records))]
        own = [material_colour(record.material) for record in self.records]
        colours = [mine if one is None else tuple(one[0].tolist()) for one, mine in zip(given, own, strict=True)]
        return list(zip(self.names, colours, strict=True))

    def times(self, count: int | None = None) -> list[float]:
        """Times since the start [s], those of the longest motion: of all its frames, or of so many of them."""
        longest = max((record.time - record.time[0] for record in self.records), key=lambda time: float(time[-1]))
        frames = np.arange(len(longest))
        if count is not None and count < len(longest):
            frames = np.rint(np.linspace(0, len(longest) - 1, count)).astype(int)
        return longest[frames].tolist()

    def panels(self, time: float) -> list[np.ndarray]:
        """Pictures of a time since the start [s], each (rows, columns, 3)."""
        parts = [self._part(number, time) for number in range(len(self.records))]
        together = [parts] if self.overlaid else [[part] for part in parts]
        return [panel_of(some, self.camera, self.oversample, self.shade) for some in together]

    def _part(self, number: int, time: float) -> Part:
        record = self.records[number]
        frame = int(np.abs(record.time - record.time[0] - time).argmin())
        return Part(record, frame, None if self.colouring is None else self.colouring.at(number, frame))


def motion_sheet(montage: Montage, path: Path, times: int = 5) -> Path:
    """The motions at evenly spread times: a row for each panel, a column for each time, and the scale of colours.

    returns  the path, whose suffix (.png, .pdf, .svg) chooses the format
    """
    shown = montage.times(times)
    figure, axes = sheet_of(len(montage.rows), len(shown), montage.camera)
    for column, time in enumerate(shown):
        for row, picture in enumerate(montage.panels(time)):
            show(axes[row][column], picture)
        axes[0][column].set_title(f"{time:.3f} s", fontsize=8)
    single = len(montage.rows) == 1
    for row, name in zip(axes, montage.rows, strict=True):
        row[0].set_ylabel("" if single else name, fontsize=9)
    scale = None if montage.colouring is None else montage.colouring.scale
    if scale is not None:
        bar = figure.colorbar(
            ScalarMappable(scale.ends, scale.colours), ax=axes, fraction=0.012, pad=0.01, ticks=MaxNLocator(4)
        )
        bar.set_label(scale.label, fontsize=7)
        bar.ax.tick_params(labelsize=7)
    if montage.legend:
        patches = [Patch(color=colour, label=name) for name, colour in montage.legend]
        figure.legend(handles=patches, loc="outside right center", fontsize=7, frameon=False)
    figure.suptitle(f"{montage.rows[0]}: {montage.title}" if single else montage.title, fontsize=10)
    return save_figure(figure, path)
