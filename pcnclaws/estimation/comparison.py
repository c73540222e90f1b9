"""Comparison of a simulated motion with what was observed: labelled markers one by one, points with the surface.

A comparison assigns the observed to the simulated. The assignment is frozen while a motion is linearised, and renewed
for each motion. That of markers is always the same.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import torch
from jaxtyping import Float, Int64
from scipy.spatial import KDTree
from torch import Tensor

from pcnclaws.data.observation import Observation, ObservedPoints
from pcnclaws.data.point_frames import by_frame
from pcnclaws.geometry.closest_points import closest_points, shares_of_corners
from pcnclaws.geometry.particle_surface import face_normals
from pcnclaws.tensors.layout import vectors_first, vectors_last

# Triangles with the nearest centres, among which a point has its closest one.
CANDIDATES = 10
# A point so near to an edge of the surface, in metres, is off it along the normal.
ON_SURFACE = 1e-9

Places: TypeAlias = Float[np.ndarray, "frames positions 3"]


class Assignment(ABC):
    """Rows of residuals, and which part of the body each of them tells of.

    part  a marker, or a patch of the surface, (rows,)
    """

    part: np.ndarray

    @abstractmethod
    def residual(self, motion: Float[Tensor, "frames 3 markers"]) -> Float[Tensor, " rows"]:
        """Simulated less observed positions [m], along the direction of each row."""

    @abstractmethod
    def change(self, rates: Float[Tensor, "frames 3 markers"]) -> Float[Tensor, " rows"]:
        """The derivative of the residual for rates of the markers."""


class Comparison(ABC):
    """What makes assignments."""

    rows: int

    @abstractmethod
    def assigned(self, motion: Float[Tensor, "frames 3 markers"], surface_offset: float = 0.0) -> Assignment:
        """The assignment of a motion.

        surface_offset  of the surface from where the volume of the body puts it [m]
        """

    @abstractmethod
    def beside(self, motion: Float[Tensor, "frames 3 markers"], surface_offset: float = 0.0) -> tuple[Places, Places]:
        """What was observed, and where the simulation puts it [m], NaN where it was not seen."""


def rates_of_offset(motion: Float[Tensor, "frames 3 markers"]) -> Float[Tensor, "frames 3 markers"]:
    """Rates of the two markers of each vertex for a surface that moves out [-]."""
    outward = motion.chunk(2, dim=2)[1]
    return torch.cat((outward, torch.zeros_like(outward)), dim=2)


def comparison_of(observation: Observation, dtype: torch.dtype) -> Comparison:
    """Points with the surface where the observation has some; otherwise markers with markers."""
    if observation.points is not None:
        return SurfaceComparison(observation.points)
    return MarkerComparison(observation, dtype)


class MarkerComparison(Comparison, Assignment):
    """Each marker with itself, in all three coordinates."""

    def __init__(self, observation: Observation, dtype: torch.dtype) -> None:
        self._seen = torch.from_numpy(observation.seen)[:, None, :].expand(-1, 3, -1)
        target = np.ascontiguousarray(vectors_first(np.nan_to_num(observation.target)))
        self._target = torch.as_tensor(target, dtype=dtype)
        self._places = observation.target
        self.rows = int(self._seen.sum())
        self.part = torch.arange(target.shape[2]).expand_as(self._seen)[self._seen].numpy()

    def assigned(self, motion: Float[Tensor, "frames 3 markers"], surface_offset: float = 0.0) -> Assignment:
        return self

    def beside(self, motion: Float[Tensor, "frames 3 markers"], surface_offset: float = 0.0) -> tuple[Places, Places]:
        return self._places, vectors_last(motion)

    def residual(self, motion: Float[Tensor, "frames 3 markers"]) -> Float[Tensor, " rows"]:
        return (motion - self._target)[self._seen]

    def change(self, rates: Float[Tensor, "frames 3 markers"]) -> Float[Tensor, " rows"]:
        return rates[self._seen]


@dataclass(frozen=True)
class SurfaceAssignment(Assignment):
    """The place of the surface that is closest to each point, and the direction from one to the other.

    The residual is their distance, negative outside of the body. Its derivative is exact: a closest place moves along
    the surface, which does not change the distance to first order.

    point      observed [m], (points, 3)
    frame      of each point, (points,)
    corner     vertices of its triangle, (points, 3)
    share      of each vertex [-], (points, 3)
    direction  unit vectors, (points, 3)
    offset     of the surface from the outermost particles [m]
    part       the patch of the surface, (points,)
    """

    point: Float[Tensor, "points 3"]
    frame: Int64[Tensor, " points"]
    corner: Int64[Tensor, "points 3"]
    share: Float[Tensor, "points 3"]
    direction: Float[Tensor, "points 3"]
    offset: float
    part: np.ndarray

    def residual(self, motion: Float[Tensor, "frames 3 markers"]) -> Float[Tensor, " points"]:
        return self.change(motion) - (self.direction * self.point).sum(1)

    def change(self, rates: Float[Tensor, "frames 3 markers"]) -> Float[Tensor, " points"]:
        particles, outward = rates.double().chunk(2, dim=2)
        return self._along(particles + self.offset * outward)

    def places(self, motion: Float[Tensor, "frames 3 markers"]) -> Float[np.ndarray, "points 3"]:
        """Places of the surface that are closest to the points [m]."""
        return (self.point + self.residual(motion)[:, None] * self.direction).numpy()

    def _along(self, vertices: Float[Tensor, "frames 3 vertices"]) -> Float[Tensor, " points"]:
        corners = vertices[self.frame[:, None], :, self.corner]
        return (self.direction * (corners * self.share[..., None]).sum(1)).sum(1)


class SurfaceComparison(Comparison):
    """Each point with the closest place of the surface of the body."""

    def __init__(self, observed: ObservedPoints) -> None:
        self._observed = observed
        self.rows = len(observed.position)
        self._first = np.searchsorted(observed.frame, np.arange(observed.frame.max() + 2))

    def assigned(self, motion: Float[Tensor, "frames 3 markers"], surface_offset: float = 0.0) -> SurfaceAssignment:
        observed, offset = self._observed, self._observed.offset + surface_offset
        particles, outward = motion.detach().double().chunk(2, dim=2)
        vertices = np.moveaxis((particles + offset * outward).numpy(), 1, 2)
        triangle, closest = np.empty(self.rows, dtype=np.int64), np.empty((self.rows, 3))
        for frame, (begin, end) in enumerate(zip(self._first[:-1], self._first[1:], strict=True)):
            if begin < end:
                corners = vertices[frame][observed.faces]
                found = _closest(observed.position[begin:end], corners)
                triangle[begin:end], closest[begin:end] = found
        corner = observed.faces[triangle]
        corners = vertices[observed.frame[:, None], corner]
        return SurfaceAssignment(
            torch.from_numpy(observed.position),
            torch.from_numpy(observed.frame),
            corner=torch.from_numpy(corner),
            share=torch.from_numpy(shares_of_corners(closest, corners)),
            direction=torch.from_numpy(_directions(observed.position, closest, corners)),
            offset=offset,
            part=observed.patch[triangle],
        )

    def beside(self, motion: Float[Tensor, "frames 3 markers"], surface_offset: float = 0.0) -> tuple[Places, Places]:
        observed, places = self._observed, self.assigned(motion, surface_offset).places(motion)
        frames = motion.shape[0]
        return by_frame(observed.position, observed.frame, frames), by_frame(places, observed.frame, frames)


def _closest(
    point: Float[np.ndarray, "points 3"], corners: Float[np.ndarray, "faces 3 3"]
) -> tuple[Int64[np.ndarray, " points"], Float[np.ndarray, "points 3"]]:
    """The triangle that is closest to each point, of those with the nearest centres, and where on it."""
    finite = np.flatnonzero(np.isfinite(corners).all((1, 2)))
    if not len(finite):
        return np.zeros(len(point), dtype=np.int64), np.full(point.shape, np.nan)
    count = min(CANDIDATES, len(finite))
    near = finite[KDTree(corners[finite].mean(1)).query(point, k=count)[1].reshape(len(point), count)]
    place = closest_points(np.repeat(point, count, axis=0), corners[near].reshape(-1, 3, 3)).reshape(-1, count, 3)
    best = np.square(place - point[:, None]).sum(2).argmin(1)
    each = np.arange(len(point))
    return near[each, best], place[each, best]


def _directions(
    point: Float[np.ndarray, "points 3"],
    closest: Float[np.ndarray, "points 3"],
    corners: Float[np.ndarray, "points 3 3"],
) -> Float[np.ndarray, "points 3"]:
    """Unit vectors outwards along the line of a point and its closest place; the normal where they are the same."""
    normal = face_normals(corners)
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    apart = point - closest
    distance = np.linalg.norm(apart, axis=1)
    sign = np.where(np.sum(apart * normal, axis=1) < 0.0, -1.0, 1.0)
    return np.where(
        (distance > ON_SURFACE)[:, None], apart * (sign / np.maximum(distance, ON_SURFACE))[:, None], normal
    )
