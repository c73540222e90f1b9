"""Panels: frames of motions as pictures of particles in the box of their domain."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from pcnclaws.rendering.camera import AZIMUTH, ELEVATION, Camera
from pcnclaws.rendering.labels import material_colour
from pcnclaws.rendering.obstacles import Scenery, highest_obstacle
from pcnclaws.rendering.spheres import Shade, draw_particles
from pcnclaws.rendering.upright import has_floor, upright
from pcnclaws.rendering.view import view_of
from pcnclaws.simulation.records import SceneRecord

PANEL_WIDTH = 300  # pixels
SPHERE_SIZE = 0.58  # radius of a drawn particle over the edge of the cube that it stands for


class Place(NamedTuple):
    """Where a camera stands, see Camera."""

    azimuth: float = AZIMUTH
    elevation: float = ELEVATION
    zoom: float = 1.0


def camera_for(records: Sequence[SceneRecord], width: int, place: Place = Place()) -> Camera:  # noqa: B008  # immutable
    """A camera that shows everything that happens in the records; they share the box of the first one."""
    view, settings = view_of(records), records[0].settings
    lower = 0.0 if settings.domain is None else settings.wall_distance / view.edge
    upper = 1.0 - lower
    if not any(has_floor(record.settings.gravity) for record in records):
        return Camera(lower, upper, upper, width, view, **place._asdict())
    upwards = [upright(view.of(record.position), record.settings.gravity)[..., 1] for record in records]
    highest = max(float(np.nanmax(heights)) for heights in upwards)
    for record in records:
        for frame in (0, len(record.time) - 1):
            highest = max(highest, highest_obstacle(view, _scenery(record, frame)))
    return Camera(lower, upper, min(max(highest + 0.04, lower + 0.3), 1.0), width, view, **place._asdict())


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
    return panel_of([Part(record, frame, colour)], camera, oversample)


class Part(NamedTuple):
    """A frame of a record in a picture; `colour`, (particles, 3), is the material's own unless given."""

    record: SceneRecord
    frame: int
    colour: np.ndarray | None = None


def panel_of(parts: Sequence[Part], camera: Camera, oversample: int = 2, shade: Shade | None = None) -> np.ndarray:
    """Picture of frames of several records in one box, with the colliders of the first, as panel."""
    position, radius, colour = [], [], []
    for record, frame, given in parts:
        own = np.tile(material_colour(record.material), (len(record.volume), 1))
        position.append(upright(camera.view.of(record.position[frame]), record.settings.gravity))
        radius.append(SPHERE_SIZE * np.cbrt(record.volume.astype(np.float64)) / camera.view.edge)
        colour.append(own if given is None else given)
    first = parts[0]
    return draw_particles(
        camera,
        np.concatenate(position),
        np.concatenate(radius),
        np.concatenate(colour),
        oversample=oversample,
        floor=has_floor(first.record.settings.gravity),
        scenery=_scenery(first.record, first.frame),
        shade=shade,
    )


def _scenery(record: SceneRecord, frame: int) -> Scenery:
    """The colliders where they are in a frame."""
    settings = record.settings
    return Scenery(
        settings.colliders, settings.start_time + float(record.time[frame] - record.time[0]), settings.gravity
    )
