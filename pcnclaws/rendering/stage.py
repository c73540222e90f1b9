"""The empty box: floor with a grid, two walls behind, and the shadow of the particles on the floor."""

from functools import lru_cache

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter, map_coordinates

from pcnclaws.rendering.camera import Camera

FLOOR, WALL, LINE, OUTSIDE = 0.93, 0.965, 0.80, 1.0
GRID_LINES_EVERY = 0.1  # m
LINE_WIDTH = 0.004  # m
SHADOW_CELLS, SHADOW_BLUR, SHADOW_DARKNESS = 160, 3.0, 0.32
LIGHT = np.array([-0.35, 1.0, 0.5]) / np.linalg.norm([-0.35, 1.0, 0.5])


@lru_cache(maxsize=2)
def rays_in_box(camera: Camera) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The rays, (rows, columns, 3), and the depths at which each enters and leaves the box, (rows, columns)."""
    rays, first, second = _crossings(camera)
    return rays, np.minimum(first, second).max(2), np.maximum(first, second).min(2)


@lru_cache(maxsize=8)
def empty_stage(
    camera: Camera, floor: bool = True
) -> tuple[Float[np.ndarray, "rows columns"], Float[np.ndarray, "rows columns 3"]]:
    """Brightness of each pixel of the empty box, and the point [m] where its ray meets the floor (NaN: nowhere).

    floor  whether the wall below is one; else it is drawn as the others are
    """
    low, high = _box(camera)
    rays, first, second = _crossings(camera)
    enters, leaves = np.minimum(first, second).max(2), np.maximum(first, second).min(2)
    exits = camera.eye + leaves[..., None] * rays
    axis = np.maximum(first, second).argmin(2)
    on_floor = (axis == 1) & floor
    to_line = np.abs((exits + 0.5 * GRID_LINES_EVERY) % GRID_LINES_EVERY - 0.5 * GRID_LINES_EVERY)
    lined = on_floor & (to_line[..., [0, 2]].min(2) < 0.5 * LINE_WIDTH)
    brightness = np.where(on_floor, FLOOR, WALL) - np.where(axis == 2, 0.0, 0.02) * ~on_floor
    brightness = np.where(lined, 0.5 * (FLOOR + LINE), brightness)
    brightness = np.where(_near_edge(exits, low, high), LINE, brightness)
    outside = leaves <= enters
    exits[outside | ~on_floor] = np.nan
    return np.where(outside, OUTSIDE, brightness), exits


def shadowed_stage(
    camera: Camera,
    position: Float[np.ndarray, "particles 3"],
    radius: Float[np.ndarray, " particles"],
    floor: bool = True,
) -> Float[np.ndarray, "rows columns"]:
    """Brightness of each pixel of the box with the soft shadow that the particles throw on the floor, if any."""
    brightness, _ = empty_stage(camera, floor)
    if not floor:
        return brightness
    cell = (camera.upper - camera.lower) / SHADOW_CELLS
    fallen = position - LIGHT * ((position[:, 1] - camera.lower) / LIGHT[1])[:, None]
    bins = np.linspace(camera.lower, camera.upper, SHADOW_CELLS + 1)
    covered, _, _ = np.histogram2d(fallen[:, 0], fallen[:, 2], bins=(bins, bins), weights=np.pi * radius**2 / cell**2)
    density = gaussian_filter(covered, max(SHADOW_BLUR, float(radius.max(initial=0.0) / cell)))
    on_floor, x, z = _floor_cells(camera, cell)
    shadowed = brightness.copy()
    shade = map_coordinates(1.0 - np.exp(-1.5 * density), (x, z), order=1, mode="nearest")
    shadowed[on_floor] *= 1.0 - SHADOW_DARKNESS * shade
    return shadowed


@lru_cache(maxsize=2)
def _floor_cells(camera: Camera, cell: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which pixels show the floor, (rows, columns), and where on it each of these is along x and z, in cells."""
    _, met = empty_stage(camera)
    on_floor = np.isfinite(met[..., 0])
    x, z = ((met[on_floor][:, k] - camera.lower) / cell - 0.5 for k in (0, 2))
    return on_floor, x, z


def _box(camera: Camera) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Lower and upper corner of what the camera shows."""
    return (
        np.array([camera.lower, camera.lower, camera.lower]),
        np.array([camera.upper, camera.top, camera.upper]),
    )


def _crossings(camera: Camera) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The rays, and the depths at which they cross the two planes of each axis, all (rows, columns, 3)."""
    rays, (low, high) = camera.rays(), _box(camera)
    with np.errstate(divide="ignore"):
        return rays, (low - camera.eye) / rays, (high - camera.eye) / rays


def _near_edge(exits: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Pixels whose ray leaves the box close to one of its edges; the open top counts as none."""
    near = (np.abs(exits - low) < LINE_WIDTH) | (np.abs(exits - high) < LINE_WIDTH)
    at_top = np.abs(exits[..., 1] - high[1]) < LINE_WIDTH
    return (near.sum(2) >= 2) & ~at_top
