"""Pictures of trajectories: one as a strip of times, or a predicted one beside the true one."""

from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.ticker import MaxNLocator

from pcnclaws.metrics import mse_sum, position_mse, rms_percent
from pcnclaws.rendering.labels import material_label
from pcnclaws.rendering.montage import Montage, motion_sheet
from pcnclaws.rendering.panels import PANEL_WIDTH, camera_for, panel
from pcnclaws.rendering.sheets import save_figure, sheet_of, show, spread, time_label
from pcnclaws.simulation.records import SceneRecord

ERROR_COLOURS = colormaps["YlOrRd"]


def picture_path(output: Path) -> Path:
    """Where the picture of a file of motion goes: beside it, under its name."""
    return output.with_name(f"{output.name}.png" if output.suffix == ".png" else f"{output.stem}.png")


def trajectory_picture(record: SceneRecord, path: Path, times: int = 5) -> Path:
    """One trajectory at `times` evenly spread frames, in a row.

    returns  the path, whose suffix (.png, .pdf, .svg) chooses the format
    """
    return motion_sheet(Montage([record], [record.name], camera_for([record], PANEL_WIDTH)), path, times)


def predicted_beside_true(
    true: SceneRecord,
    predicted: SceneRecord,
    path: Path,
    *,
    times: int = 5,
    words: tuple[str, str] = ("true", "predicted"),
    warning: str = "",
) -> Path:
    """The true trajectory above the predicted one at `times` evenly spread frames.

    The predicted particles are coloured by their distance from the true ones.
    true, predicted  the same particles at the same frames
    words            what the two are called
    warning          a second line of the title
    """
    camera = camera_for([true, predicted], PANEL_WIDTH)
    frames = spread(true, times)
    figure, axes = sheet_of(2, len(frames), camera)
    distance = 1e3 * np.linalg.norm(predicted.position[frames] - true.position[frames], axis=2)
    scale = Normalize(0.0, _upper_end(distance), clip=True)
    for column, frame in enumerate(frames):
        colour = ERROR_COLOURS(scale(np.nan_to_num(distance[column])))[:, :3]
        show(axes[0][column], panel(true, int(frame), camera))
        show(axes[1][column], panel(predicted, int(frame), camera, colour))
        axes[0][column].set_title(time_label(true, int(frame)), fontsize=8)
    for row, word in zip(axes, words, strict=True):
        row[0].set_ylabel(word, fontsize=9)
    bar = figure.colorbar(
        ScalarMappable(scale, ERROR_COLOURS), ax=axes[1], fraction=0.012, pad=0.01, extend="max", ticks=MaxNLocator(4)
    )
    bar.set_label(f"distance from {words[0]} [mm]", fontsize=7)
    bar.ax.tick_params(labelsize=7)
    figure.suptitle(f"{_comparison_title(true, predicted)}\n{warning}".strip(), fontsize=10)
    return save_figure(figure, path)


def _comparison_title(true: SceneRecord, predicted: SceneRecord) -> str:
    mse = position_mse(predicted.position, true.position)
    percent = rms_percent(mse_sum(mse), true.volume)
    label = material_label(true.material, true.parameters)
    return f"{true.name}: {label}   |   MSE {mse:.2g} m², RMS {percent:.2g} % of the object's size"


def _upper_end(distance: np.ndarray) -> float:
    """Upper end of the colour scale [mm], nearly the largest distance; positive also where all are zero."""
    return max(float(np.nanquantile(distance, 0.995)), 1e-3)
