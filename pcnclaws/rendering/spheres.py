"""Sphere rendering of particles: a small software renderer, so that pictures need nothing but NumPy."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Float, UInt8
from scipy.ndimage import maximum_filter, uniform_filter

from pcnclaws.rendering.camera import Camera
from pcnclaws.rendering.obstacles import Scenery, draw_obstacles
from pcnclaws.rendering.stage import LIGHT, shadowed_stage

AMBIENT, DIFFUSE = 0.58, 0.52
OCCLUSION_REACH, OCCLUSION_STRENGTH, DARKEST = 0.04, 6.0, 0.6
SAMPLES_AT_A_TIME = 300_000
# Edge of the parts of the picture in which the nearest spheres are looked for, in radii.
TILE = 2.5

Colours = Float[np.ndarray, "particles 3"]
Picture = UInt8[np.ndarray, "rows columns 3"]
# Spheres as a camera sees them: the picture and its depths, see shaded_spheres.
Shade: TypeAlias = Callable[[Camera, np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


def draw_particles(
    camera: Camera,
    position: Float[np.ndarray, "particles 3"],
    radius: Float[np.ndarray, " particles"],
    colour: Colours,
    *,
    oversample: int = 2,
    floor: bool = True,
    scenery: Scenery | None = None,
    shade: Shade | None = None,
) -> Picture:
    """Picture of spheres in the box that the camera shows.

    position    [m], (particles, 3); particles with NaN are left out
    radius      [m], (particles,)
    colour      red, green and blue from 0 to 1, (particles, 3)
    oversample  pixels of the drawing along one of the picture, against jagged edges
    floor       whether the wall below is a floor, with a grid and a shadow
    scenery     the colliders, if any
    shade       how spheres are drawn; shaded_spheres unless given
    """
    seen = np.isfinite(position).all(1)
    position, radius, colour = position[seen].astype(np.float64), radius[seen], colour[seen]
    fine = replace(camera, width=camera.width * oversample)
    stage = shadowed_stage(fine, position, radius, floor).astype(np.float32)
    picture, depth = (shaded_spheres if shade is None else shade)(fine, position, radius, colour)
    canvas = np.where(np.isfinite(depth)[..., None], picture, stage[..., None])
    if scenery is not None and scenery.colliders:
        draw_obstacles(canvas, fine, scenery, depth, line=oversample)
    return _shrunk(canvas, oversample, camera)


def shaded_spheres(
    camera: Camera, position: np.ndarray, radius: np.ndarray, colour: Colours
) -> tuple[np.ndarray, np.ndarray]:
    """Red, green and blue from 0 to 1 of each pixel, (rows, columns, 3), and its depth, infinite where no sphere is."""
    owner, depth, facing = _rasterise(camera, position, radius)
    light = (AMBIENT + DIFFUSE * facing) * _occlusion(camera, depth, owner >= 0)
    picture = colour.astype(np.float32)[owner] if len(colour) else np.zeros((*owner.shape, 3), np.float32)
    picture *= light.astype(np.float32)[..., None]
    np.minimum(picture, np.float32(1.0), out=picture)
    return picture, depth


def _rasterise(camera: Camera, position: np.ndarray, radius: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """For each pixel the nearest sphere (-1: none), its depth [m] and how much its surface faces the light."""
    column, row, depth = (values.astype(np.float32) for values in camera.project(position))
    discs = _Discs(column, row, depth, radius, (radius * camera.pixels_per_unit / depth).astype(np.float32))
    owner, nearest = (
        np.full((camera.height, camera.width), -1),
        np.full((camera.height, camera.width), np.float32(np.inf)),
    )
    front = _in_front(camera, discs)
    _draw(owner, nearest, discs, np.flatnonzero(front))
    behind = np.flatnonzero(~front)
    _draw(owner, nearest, discs, behind[~_hidden(nearest, discs, behind)])
    return owner, nearest, _facing(camera, owner, discs)


class _Discs(NamedTuple):
    """Spheres on the picture: column, row and size [pixels], depth and radius [m], each (particles,)."""

    column: np.ndarray
    row: np.ndarray
    depth: np.ndarray
    radius: np.ndarray
    size: np.ndarray


def _in_front(camera: Camera, discs: _Discs) -> np.ndarray:
    """Spheres that are about the nearest ones in their part of the picture, (particles,): they hide most others."""
    tile = max(1.0, TILE * float(discs.size.max(initial=1.0)))
    across = int(camera.width / tile) + 1
    i = np.clip(discs.row / tile, 0, int(camera.height / tile)).astype(np.int64)
    part = i * across + np.clip(discs.column / tile, 0, across - 1).astype(np.int64)
    nearest = np.full(part.max(initial=0) + 1, np.inf, np.float32)
    np.minimum.at(nearest, part, discs.depth)
    return discs.depth < nearest[part] + TILE * discs.radius


def _hidden(nearest: np.ndarray, discs: _Discs, some: np.ndarray) -> np.ndarray:
    """Which of some spheres lie behind what is drawn wherever they could be seen."""
    if not len(some):
        return np.zeros(0, dtype=np.bool_)
    rows, columns = nearest.shape
    reach = 2 * int(np.ceil(discs.size[some].max())) + 3
    farthest = maximum_filter(nearest, reach, mode="nearest")
    i = np.clip(np.rint(discs.row[some]).astype(np.int64), 0, rows - 1)
    j = np.clip(np.rint(discs.column[some]).astype(np.int64), 0, columns - 1)
    return farthest[i, j] < discs.depth[some] - discs.radius[some]


def _draw(owner: np.ndarray, nearest: np.ndarray, discs: _Discs, which: np.ndarray) -> None:
    """Draws some spheres: changes owner and depth of the pixels, in place, where they are the nearest."""
    rows, columns = owner.shape
    owner, nearest = owner.reshape(-1), nearest.reshape(-1)
    reach = int(np.ceil(discs.size[which].max(initial=0.0)))
    offset = np.arange(-reach, reach + 1)
    for some in np.array_split(which, 1 + len(which) * len(offset) ** 2 // SAMPLES_AT_A_TIME):
        column, row, depth, radius, size = (values[some, None] for values in discs)
        r, c = np.rint(row).astype(np.int64) + offset, np.rint(column).astype(np.int64) + offset
        # what lies outside the picture is put outside the sphere
        up = np.where((r >= 0) & (r < rows), ((row - r) / size) ** 2, 1.0).astype(np.float32)
        across = np.where((c >= 0) & (c < columns), ((c - column) / size) ** 2, 1.0).astype(np.float32)
        left = (np.float32(1.0) - across)[:, None, :] - up[:, :, None]
        inside = left > 0.0
        pixel = (r[:, :, None] * columns + c[:, None, :])[inside]
        per_sphere = np.count_nonzero(inside, axis=(1, 2))
        far, thick = (np.repeat(values[:, 0].astype(np.float32), per_sphere) for values in (depth, radius))
        surface = far - thick * np.sqrt(left[inside])
        np.minimum.at(nearest, pixel, surface)
        front = surface == nearest[pixel]
        owner[pixel[front]] = np.repeat(some, per_sphere)[front]


def _facing(camera: Camera, owner: np.ndarray, discs: _Discs) -> np.ndarray:
    """How much the surface that each pixel shows faces the light, 0 where it shows none."""
    r, c = np.nonzero(owner >= 0)
    shown = owner[r, c]
    y, x = (discs.row[shown] - r) / discs.size[shown], (c - discs.column[shown]) / discs.size[shown]
    z = np.sqrt(np.maximum(1.0 - x**2 - y**2, 0.0))
    facing = np.zeros(owner.shape, dtype=np.float32)
    right, up, towards = (camera.axes @ LIGHT).astype(np.float32)
    facing[r, c] = np.maximum(right * x + up * y + towards * z, 0.0)
    return facing


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
