"""Sphere rendering of particles: a small software renderer, so that pictures need nothing but NumPy."""

import numpy as np
from jaxtyping import Float, UInt8
from scipy.ndimage import uniform_filter

from pcnclaws.rendering.camera import Camera
from pcnclaws.rendering.obstacles import Scenery, draw_obstacles
from pcnclaws.rendering.stage import LIGHT, shadowed_stage

AMBIENT, DIFFUSE = 0.58, 0.52
OCCLUSION_REACH, OCCLUSION_STRENGTH, DARKEST = 0.04, 6.0, 0.6
SAMPLES_AT_A_TIME = 2_000_000

Colours = Float[np.ndarray, "particles 3"]
Picture = UInt8[np.ndarray, "rows columns 3"]


def draw_particles(
    camera: Camera,
    position: Float[np.ndarray, "particles 3"],
    radius: Float[np.ndarray, " particles"],
    colour: Colours,
    *,
    oversample: int = 2,
    floor: bool = True,
    scenery: Scenery | None = None,
) -> Picture:
    """Picture of spheres in the box that the camera shows.

    position    [m], (particles, 3); particles with NaN are left out
    radius      [m], (particles,)
    colour      red, green and blue from 0 to 1, (particles, 3)
    oversample  pixels of the drawing along one of the picture, against jagged edges
    floor       whether the wall below is a floor, with a grid and a shadow
    scenery     the colliders, if any
    """
    seen = np.isfinite(position).all(1)
    position, radius, colour = position[seen].astype(np.float64), radius[seen], colour[seen]
    fine = Camera(camera.lower, camera.upper, camera.top, camera.width * oversample)
    canvas = np.repeat(shadowed_stage(fine, position, radius, floor)[..., None].astype(np.float32), 3, axis=2)
    owner, depth, facing = _rasterise(fine, position, radius)
    hit = owner >= 0
    light = (AMBIENT + DIFFUSE * facing) * _occlusion(fine, depth, hit)
    canvas[hit] = np.clip(colour[owner[hit]] * light[hit][:, None], 0.0, 1.0)
    if scenery is not None and scenery.colliders:
        draw_obstacles(canvas, fine, scenery, depth, line=oversample)
    return _shrunk(canvas, oversample, camera)


def _rasterise(camera: Camera, position: np.ndarray, radius: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """For each pixel the nearest sphere (-1: none), its depth [m] and how much its surface faces the light."""
    rows, columns = camera.height, camera.width
    owner, nearest = np.full(rows * columns, -1), np.full(rows * columns, np.inf, dtype=np.float32)
    facing = np.zeros(rows * columns, dtype=np.float32)
    column, row, depth = (values.astype(np.float32) for values in camera.project(position))
    size = (radius * camera.pixels_per_unit / depth).astype(np.float32)
    offset = np.arange(-int(np.ceil(size.max(initial=0.0))), int(np.ceil(size.max(initial=0.0))) + 1)
    light = (camera.axes @ LIGHT).astype(np.float32)
    for some in np.array_split(np.arange(len(size)), 1 + len(size) * len(offset) ** 2 // SAMPLES_AT_A_TIME):
        r = np.rint(row[some, None]).astype(np.int64) + offset
        c = np.rint(column[some, None]).astype(np.int64) + offset
        y, x = (row[some, None] - r) / size[some, None], (c - column[some, None]) / size[some, None]
        # what lies outside the picture is put outside the sphere
        up, across = np.where((r >= 0) & (r < rows), y**2, 1.0), np.where((c >= 0) & (c < columns), x**2, 1.0)
        which, i, j = np.nonzero(up[:, :, None] + across[:, None, :] < 1.0)
        x, y, pixel, particle = x[which, j], y[which, i], r[which, i] * columns + c[which, j], some[which]
        z = np.sqrt(1.0 - x**2 - y**2)
        surface = (depth[particle] - radius[particle] * z).astype(np.float32)
        np.minimum.at(nearest, pixel, surface)
        front = surface == nearest[pixel]
        owner[pixel[front]] = particle[front]
        facing[pixel[front]] = np.maximum(light @ np.stack((x[front], y[front], z[front])).astype(np.float32), 0.0)
    shape = (rows, columns)
    return owner.reshape(shape), nearest.reshape(shape), facing.reshape(shape)


def _occlusion(camera: Camera, depth: np.ndarray, hit: np.ndarray) -> np.ndarray:
    """Darkens what lies deeper than its surroundings (Luft et al. 2006, "Image enhancement by unsharp masking
    the depth buffer"); 1 in the open."""
    reach = max(3, round(OCCLUSION_REACH * camera.width))
    weight = uniform_filter(hit.astype(np.float32), reach)
    around = uniform_filter(np.where(hit, depth, np.float32(0.0)), reach) / np.maximum(weight, 1e-6)
    deeper = np.where(hit, depth - around, 0.0)
    return np.clip(1.0 - OCCLUSION_STRENGTH * deeper, DARKEST, 1.0)


def _shrunk(canvas: np.ndarray, oversample: int, camera: Camera) -> Picture:
    """The drawing averaged down to the camera's picture."""
    rows = camera.height
    missing = rows * oversample - canvas.shape[0]
    canvas = np.pad(canvas, ((0, max(missing, 0)), (0, 0), (0, 0)), mode="edge")[: rows * oversample]
    parts = [canvas[i::oversample, j::oversample] for i in range(oversample) for j in range(oversample)]
    return np.rint(255.0 * np.mean(parts, axis=0)).astype(np.uint8)
