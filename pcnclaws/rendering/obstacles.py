"""Colliders in pictures: translucent surfaces, found by following the camera's rays through their signed distances."""

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float
from scipy.ndimage import binary_erosion

from pcnclaws.mpm.colliders import Collider, Plane
from pcnclaws.mpm.distance_fields import SignedDistance
from pcnclaws.mpm.numbers import span_holds
from pcnclaws.rendering.camera import Camera
from pcnclaws.rendering.stage import LIGHT, rays_in_box
from pcnclaws.rendering.upright import Gravity, not_upright, upright
from pcnclaws.rendering.view import View

# Paces along a ray, in edges of the view; who knows whether a function of somebody's own is a distance.
SHORTEST, LONGEST, LONGEST_OF_FUNCTION = 0.004, 1.0, 0.03
# Points along each axis of the view that tell how high colliders reach.
LOOKED_AT = 32
COLOUR = np.array([0.36, 0.47, 0.62])
OPACITY, OPACITY_OF_OUTLINE = 0.5, 0.85
AMBIENT, DIFFUSE = 0.72, 0.4

Canvas = Float[np.ndarray, "rows columns 3"]


class Scenery(NamedTuple):
    """The colliders of a scene at a time [s]; gravity says which way is up in the picture."""

    colliders: Sequence[Collider]
    time: float
    gravity: Gravity


class _Surface(NamedTuple):
    """What each pixel's ray meets first: its depth (infinite: nothing), how bright it is, and which collider."""

    depth: Float[np.ndarray, "rows columns"]
    light: Float[np.ndarray, "rows columns"]
    owner: np.ndarray


def draw_obstacles(
    canvas: Canvas, camera: Camera, scenery: Scenery, nearest: Float[np.ndarray, "rows columns"], line: int = 1
) -> None:
    """Lays the surfaces of the colliders over a picture, where nothing is nearer.

    canvas   red, green and blue from 0 to 1, changed in place
    nearest  depth of what is drawn already, infinite where that is far behind
    line     width of outlines [pixels]
    """
    surface = _surface(camera, scenery)
    seen = np.isfinite(surface.depth) & (surface.depth < nearest)
    outline = seen & _outlines(surface, line)
    opacity = np.where(outline, OPACITY_OF_OUTLINE, OPACITY)[seen][:, None]
    shade = np.where(outline, 0.6, surface.light)[seen][:, None] * COLOUR
    canvas[seen] = (1.0 - opacity) * canvas[seen] + opacity * np.clip(shade, 0.0, 1.0)


@torch.no_grad()
def highest_obstacle(view: View, scenery: Scenery) -> float:
    """How high colliders reach in the picture, in edges of the view; planes, which have no end, count for nothing."""
    along = (np.arange(LOOKED_AT) + 0.5) / LOOKED_AT
    points = np.stack(np.meshgrid(along, along, along, indexing="ij"), axis=-1).reshape(-1, 3)
    highest = 0.0
    for collider in scenery.colliders:
        if isinstance(collider.shape, Plane) or not span_holds(collider.start, collider.end, scenery.time):
            continue
        inside = _distance(view, collider, scenery.time, scenery.gravity, points)[0] <= 0.5 / LOOKED_AT
        highest = max(highest, float(points[inside, 1].max(initial=0.0)))
    return highest


def _surface(camera: Camera, scenery: Scenery) -> _Surface:
    shape = (camera.height, camera.width)
    depth, light = np.full(shape, np.inf), np.zeros(shape)
    owner = np.full(shape, -1)
    for number, collider in enumerate(scenery.colliders):
        if not span_holds(collider.start, collider.end, scenery.time):
            continue
        here, of_here = _met(camera, collider, scenery.time if collider.moves else 0.0, scenery.gravity)
        nearer = here < depth
        depth[nearer], light[nearer], owner[nearer] = here[nearer], of_here[nearer], number
    return _Surface(depth, light, owner)


# most colliders are in the same place in all pictures
@lru_cache(maxsize=16)
@torch.no_grad()
def _met(camera: Camera, collider: Collider, time: float, gravity: Gravity) -> tuple[np.ndarray, np.ndarray]:
    """Depth at which each ray enters a collider (infinite: nowhere), and how bright it is there."""
    rays, enters, leaves = (array.reshape(camera.height * camera.width, -1) for array in rays_in_box(camera))
    along, end = enters[:, 0].copy(), leaves[:, 0]
    depth, light = np.full(len(rays), np.inf), np.zeros(len(rays))
    active = np.flatnonzero(along < end)
    longest = LONGEST_OF_FUNCTION if isinstance(collider.shape, SignedDistance) else LONGEST
    while len(active):
        distance = _distance(camera.view, collider, time, gravity, camera.eye + along[active, None] * rays[active])[0]
        met = distance <= 0.0
        depth[active[met]] = along[active[met]] + np.minimum(distance[met], 0.0)
        active = active[~met]
        along[active] += np.clip(distance[~met], SHORTEST, longest)
        active = active[along[active] < end[active]]
    hit = np.flatnonzero(np.isfinite(depth))
    if len(hit):
        depth[hit] = np.maximum(depth[hit], enters[hit, 0])
        # what a ray meets at the side of the box is cut open there
        cut = depth[hit] <= enters[hit, 0] + SHORTEST
        normal = _distance(camera.view, collider, time, gravity, camera.eye + depth[hit, None] * rays[hit])[1]
        light[hit] = np.where(cut, 1.15, AMBIENT + DIFFUSE * np.maximum(normal @ LIGHT, 0.0))
    return depth.reshape(camera.height, camera.width), light.reshape(camera.height, camera.width)


def _distance(
    view: View, collider: Collider, time: float, gravity: Gravity, points: Float[np.ndarray, "points 3"]
) -> tuple[Float[np.ndarray, " points"], Float[np.ndarray, "points 3"]]:
    """Signed distance in edges of the view, and normal in the picture's directions, at points of the picture."""
    place = np.array(view.origin) + view.edge * not_upright(points, gravity)
    distance, normal, _ = collider.distance(torch.from_numpy(place.T.copy()), time)
    return distance.numpy() / view.edge, upright(normal.numpy().T + 0.5, gravity) - 0.5


def _outlines(surface: _Surface, line: int) -> Bool[np.ndarray, "rows columns"]:
    """Pixels at the edge of what a collider covers."""
    edge = np.zeros(surface.owner.shape, dtype=np.bool_)
    for number in np.unique(surface.owner[surface.owner >= 0]):
        covered = surface.owner == number
        edge |= covered & np.logical_not(binary_erosion(covered, iterations=line, border_value=1))
    return edge
