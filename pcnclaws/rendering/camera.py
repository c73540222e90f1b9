"""A perspective camera that looks at the box in which a scene happens."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from pcnclaws.rendering.view import UNIT_VIEW, View

Points = Float[np.ndarray, "points 3"]

AZIMUTH, ELEVATION = 28.0, 17.0  # degrees
DISTANCE = 3.0
MARGIN = 0.02


@dataclass(frozen=True)
class Camera:
    """A camera in front of the box [lower, upper]^3, from `lower` up to `top`, which fills the picture.

    lower, upper  inner faces of the walls, in edges of the view
    top           height up to which the picture reaches, the same
    width         of the picture [pixels]; its height follows
    view          the cube of space that is the unit box of all these lengths
    azimuth       from the z axis towards the x axis, where the camera stands [degrees]
    elevation     above the floor [degrees], between -90 and 90
    zoom          how much larger than to fill the picture the box is shown
    """

    lower: float
    upper: float
    top: float
    width: int
    view: View = UNIT_VIEW
    azimuth: float = AZIMUTH
    elevation: float = ELEVATION
    zoom: float = 1.0

    @property
    def corners(self) -> Points:
        """The 8 corners of the box [m], y innermost, (8, 3)."""
        sides = (self.lower, self.upper)
        return np.array([(x, y, z) for x in sides for z in sides for y in (self.lower, self.top)])

    @cached_property
    def axes(self) -> Float[np.ndarray, "3 3"]:
        """Rows: right, up, and from the target towards the camera, unit vectors."""
        azimuth, elevation = np.radians(self.azimuth), np.radians(self.elevation)
        level = np.cos(elevation)
        towards = np.array([np.sin(azimuth) * level, np.sin(elevation), np.cos(azimuth) * level])
        right = np.cross([0.0, 1.0, 0.0], towards)
        right /= np.linalg.norm(right)
        return np.stack((right, np.cross(towards, right), towards))

    @cached_property
    def eye(self) -> Float[np.ndarray, "3"]:
        """Where the camera is [m]."""
        middle = 0.5 * (self.lower + self.upper)
        return np.array([middle, 0.5 * (self.lower + self.top), middle]) + DISTANCE * self.axes[2]

    @cached_property
    def window(self) -> tuple[float, float, float, float]:
        """Left, top, right and bottom of the picture on the plane at distance 1 of the eye."""
        plane = self._on_plane(self.corners)[0]
        (left, bottom), (right, top) = plane.min(0), plane.max(0)
        pad = MARGIN * (right - left)
        x, y, shown = 0.5 * (left + right), 0.5 * (top + bottom), 1.0 / self.zoom
        half, tall = shown * (0.5 * (right - left) + pad), shown * (0.5 * (top - bottom) + pad)
        return x - half, y + tall, x + half, y - tall

    @property
    def pixels_per_unit(self) -> float:
        """Pixels in a length of 1 m at a distance of 1 m."""
        left, _, right, _ = self.window
        return self.width / (right - left)

    @property
    def height(self) -> int:
        """Height of the picture [pixels]."""
        _, top, _, bottom = self.window
        return round((top - bottom) * self.pixels_per_unit)

    def project(self, points: Points) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Column and row [pixels] and depth [m] of points [m], each (points,)."""
        plane, depth = self._on_plane(points)
        left, top, _, _ = self.window
        return (plane[:, 0] - left) * self.pixels_per_unit, (top - plane[:, 1]) * self.pixels_per_unit, depth

    def rays(self) -> Float[np.ndarray, "rows columns 3"]:
        """Direction from the eye through the middle of each pixel, with depth 1."""
        left, top, _, _ = self.window
        x = left + (np.arange(self.width) + 0.5) / self.pixels_per_unit
        y = top - (np.arange(self.height) + 0.5) / self.pixels_per_unit
        right, up, towards = self.axes
        return x[None, :, None] * right + y[:, None, None] * up - towards

    def _on_plane(self, points: Points) -> tuple[Float[np.ndarray, "points 2"], Float[np.ndarray, " points"]]:
        right, up, depth = self.axes @ (points - self.eye).T * np.array([[1.0], [1.0], [-1.0]])
        return np.stack((right / depth, up / depth), axis=1), depth
