"""Pictures of trajectories: one as a strip of times, or a predicted one beside the true one."""

from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from pcnclaws.atomic import replaced_file
from pcnclaws.metrics import mse_sum, position_mse, rms_percent
from pcnclaws.rendering.camera import Camera
from pcnclaws.rendering.labels import material_colour, material_label
from pcnclaws.rendering.obstacles import Scenery, highest_obstacle
from pcnclaws.rendering.spheres import draw_particles
from pcnclaws.rendering.upright import has_floor, upright
from pcnclaws.rendering.view import view_of
from pcnclaws.simulation.records import SceneRecord

PANEL_WIDTH = 300  # pixels
SPHERE_SIZE = 0.58  # radius of a drawn particle over the edge of the cube that it stands for
ERROR_COLOURS = colormaps["YlOrRd"]
DPI = 150


def picture_path(output: Path) -> Path:
    """Where the picture of a file of motion goes: beside it, under its name."""
    return output.with_name(f"{output.name}.png" if output.suffix == ".png" else f"{output.stem}.png")


def trajectory_picture(record: SceneRecord, path: Path, times: int = 5) -> Path:
    """One trajectory at `times` evenly spread frames, in a row.

    returns  the path, whose suffix (.png, .pdf, .svg) chooses the format
    """
    camera = camera_for([record], PANEL_WIDTH)
    figure, axes = _sheet(1, min(times, len(record.time)), camera)
    figure.suptitle(f"{record.name}: {material_label(record.material, record.parameters)}", fontsize=10)
    for axis, frame in zip(axes[0], _spread(record, times), strict=True):
        _show(axis, panel(record, int(frame), camera))
        axis.set_title(_time_label(record, int(frame)), fontsize=8)
    return _save(figure, path)


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
    frames = _spread(true, times)
    figure, axes = _sheet(2, len(frames), camera)
    distance = 1e3 * np.linalg.norm(predicted.position[frames] - true.position[frames], axis=2)
    scale = Normalize(0.0, _upper_end(distance), clip=True)
    for column, frame in enumerate(frames):
        colour = ERROR_COLOURS(scale(np.nan_to_num(distance[column])))[:, :3]
        _show(axes[0][column], panel(true, int(frame), camera))
        _show(axes[1][column], panel(predicted, int(frame), camera, colour))
        axes[0][column].set_title(_time_label(true, int(frame)), fontsize=8)
    for row, word in zip(axes, words, strict=True):
        row[0].set_ylabel(word, fontsize=9)
    bar = figure.colorbar(
        ScalarMappable(scale, ERROR_COLOURS), ax=axes[1], fraction=0.012, pad=0.01, extend="max", ticks=MaxNLocator(4)
    )
    bar.set_label(f"distance from {words[0]} [mm]", fontsize=7)
    bar.ax.tick_params(labelsize=7)
    figure.suptitle(f"{_comparison_title(true, predicted)}\n{warning}".strip(), fontsize=10)
    return _save(figure, path)


def camera_for(records: list[SceneRecord], width: int) -> Camera:
    """A camera that shows everything that happens in the records; they share the box of the first one."""
    view, settings = view_of(records), records[0].settings
    lower = 0.0 if settings.domain is None else settings.wall_distance / view.edge
    upper = 1.0 - lower
    if not any(has_floor(record.settings.gravity) for record in records):
        return Camera(lower, upper, upper, width, view)
    upwards = [upright(view.of(record.position), record.settings.gravity)[..., 1] for record in records]
    highest = max(float(np.nanmax(heights)) for heights in upwards)
    for record in records:
        for frame in (0, len(record.time) - 1):
            highest = max(highest, highest_obstacle(view, _scenery(record, frame)))
    return Camera(lower, upper, min(max(highest + 0.04, lower + 0.3), 1.0), width, view)


def panel(
    record: SceneRecord,
    frame: int,
    camera: Camera,
    colour: Float[np.ndarray, "particles 3"] | None = None,
    oversample: int = 2,
) -> np.ndarray:
    """Picture of one frame, (rows, columns, 3) uint8; `colour` is the material's own unless given.

    The floor is the wall that gravity points to; without gravity there is none. Colliders are where they are then.
    """
    if colour is None:
        colour = np.tile(material_colour(record.material), (len(record.volume), 1))
    radius = SPHERE_SIZE * np.cbrt(record.volume.astype(np.float64)) / camera.view.edge
    gravity = record.settings.gravity
    position = upright(camera.view.of(record.position[frame]), gravity)
    return draw_particles(
        camera,
        position,
        radius,
        colour,
        oversample=oversample,
        floor=has_floor(gravity),
        scenery=_scenery(record, frame),
    )


def _scenery(record: SceneRecord, frame: int) -> Scenery:
    """The colliders where they are in a frame."""
    settings = record.settings
    return Scenery(
        settings.colliders, settings.start_time + float(record.time[frame] - record.time[0]), settings.gravity
    )


def _comparison_title(true: SceneRecord, predicted: SceneRecord) -> str:
    mse = position_mse(predicted.position, true.position)
    percent = rms_percent(mse_sum(mse), true.volume)
    label = material_label(true.material, true.parameters)
    return f"{true.name}: {label}   |   MSE {mse:.2g} m², RMS {percent:.2g} % of the object's size"


def _spread(record: SceneRecord, times: int) -> np.ndarray:
    """Indices of evenly spread frames, the first and the last among them."""
    count = len(record.time)
    return np.rint(np.linspace(0, count - 1, min(times, count))).astype(int)


def _upper_end(distance: np.ndarray) -> float:
    """Upper end of the colour scale [mm], nearly the largest distance; positive also where all are zero."""
    return max(float(np.nanquantile(distance, 0.995)), 1e-3)


def _time_label(record: SceneRecord, frame: int) -> str:
    return f"{record.time[frame] - record.time[0]:.3f} s"


def _sheet(rows: int, columns: int, camera: Camera) -> tuple[Figure, np.ndarray]:
    """Empty figure with a grid of axes, (rows, columns), sized for pictures of the camera."""
    width, height = camera.width / DPI, camera.height / DPI
    figure = Figure(figsize=(columns * width + 1.1, rows * height + 0.65), dpi=DPI, layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False)


def _show(axis: Axes, picture: np.ndarray) -> None:
    axis.imshow(picture, interpolation="antialiased")
    axis.set_xticks([])
    axis.set_yticks([])
    for spine in axis.spines.values():
        spine.set_visible(False)


def _save(figure: Figure, path: Path) -> Path:
    with replaced_file(path) as unfinished:
        figure.savefig(unfinished, format=path.suffix[1:], dpi=DPI)
    return path
