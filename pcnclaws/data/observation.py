"""Observed motion: where some points of a body were at some times, and the body that they belong to."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int64

from pcnclaws.errors import UserError
from pcnclaws.mpm.settings import SimulationSettings


class ObservedPoints(NamedTuple):
    """Points on the surface of a body that bear no labels, in any order within a frame.

    The surface has two markers for each of its vertices: the particle, and, in the second half, the vector by which the
    vertex moves where the surface moves out by 1. Weights of the latter have sums of 0.

    position  [m], (points, 3)
    frame     of each point, increasing, (points,)
    faces     vertices of the triangles of the surface, counterclockwise seen from outside, (faces, 3)
    patch     of the surface that each triangle belongs to, (faces,)
    offset    of the surface from the outermost particles [m]
    """

    position: Float[np.ndarray, "points 3"]
    frame: Int64[np.ndarray, " points"]
    faces: Int64[np.ndarray, "faces 3"]
    patch: Int64[np.ndarray, " faces"]
    offset: float

    def of_frames(self, kept: Bool[np.ndarray, " frames"]) -> "ObservedPoints":
        """The points of some frames, which are numbered anew."""
        mine = kept[self.frame]
        return self._replace(position=self.position[mine], frame=(np.cumsum(kept) - 1)[self.frame[mine]])


@dataclass(frozen=True)
class Observation:
    """Observed motion, and the undeformed body at its start.

    time              of the frames, since the start of the simulation [s], (frames,)
    target            observed positions of the markers [m], (frames, markers, 3), NaN where one was not seen
    particle          the particles that each marker follows, (markers, followed)
    weight            of each of them [-], (markers, followed), sums of 1
    position          of the particles at the start [m], (particles, 3)
    volume            [m^3], (particles,)
    initial_velocity  of the particles [m/s], (particles, 3), None where it is not known
    truth             physical parameters that the file stores, for a look beside the estimate, and for nothing else
    initial_affine    APIC velocity gradient C of the particles [1/s], (particles, 3, 3), None for 0
    spins_have_gradient  whether a spin that is sought starts with its velocity gradient as C, too
    density           of each particle [kg/m^3], (particles,), None where it is that of the settings
    registration      of the frame of a file, as plain values, None where it is the simulation's own
    points            that bear no labels, in place of seen markers
    """

    name: str
    material: str
    settings: SimulationSettings
    time: Float[np.ndarray, " frames"]
    target: Float[np.ndarray, "frames markers 3"]
    particle: Int64[np.ndarray, "markers followed"]
    weight: Float[np.ndarray, "markers followed"]
    position: Float[np.ndarray, "particles 3"]
    volume: Float[np.ndarray, " particles"]
    initial_velocity: Float[np.ndarray, "particles 3"] | None
    truth: Mapping[str, float]
    initial_affine: Float[np.ndarray, "particles 3 3"] | None = None
    spins_have_gradient: bool = True
    density: Float[np.ndarray, " particles"] | None = None
    registration: Mapping[str, Any] | None = None
    points: ObservedPoints | None = None

    @property
    def seen(self) -> Bool[np.ndarray, "frames markers"]:
        """Where a marker was seen, (frames, markers)."""
        return np.asarray(np.isfinite(self.target).all(2))

    @property
    def places(self) -> Float[np.ndarray, "markers 3"]:
        """Where the markers are at the start [m]."""
        return np.einsum("mk,mkc->mc", self.weight, self.position[self.particle])

    @property
    def spacing(self) -> float:
        """Distance of neighbouring particles [m]: the edge of the cube that one stands for."""
        return float(np.mean(self.volume) ** (1.0 / 3.0))

    def between(self, first: float, last: float) -> "Observation":
        """The frames from one time to another [s]; UserError where none is left."""
        kept = (self.time >= first) & (self.time <= last)
        if not self._tells[kept].any():
            raise UserError(
                f"observation.window=[{first:g}, {last:g}] holds no observed position; "
                f"accepted: two times within {self.time[0]:g} and {self.time[-1]:g} s"
            )
        points = None if self.points is None else self.points.of_frames(kept)
        return replace(self, time=self.time[kept], target=self.target[kept], points=points)

    @property
    def positions(self) -> int:
        """How many were observed."""
        return int(self.seen.sum()) if self.points is None else len(self.points.position)

    @property
    def _tells(self) -> Bool[np.ndarray, " frames"]:
        """Which frames hold an observed position."""
        if self.points is None:
            return np.asarray(self.seen.any(1))
        return np.bincount(self.points.frame, minlength=len(self.time)) > 0
