"""Motions of an elastic body with a known answer, without gravity and walls.

Poisson's ratio is 0, where fixed corotated elasticity is linear along each axis and the answers are exact. The strains
are so small that another law of the same moduli hardly differs.
"""

import math
from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from benchmarks.cell_lattices import Box

DENSITY = 1000.0
YOUNGS_MODULUS = 4e5
PARAMETERS = {"youngs_modulus": YOUNGS_MODULUS, "poissons_ratio": 0.0}


class Motion(NamedTuple):
    """Where the points of a body are at one time.

    position     [m], (particles, 3)
    velocity     [m/s], (particles, 3)
    affine       velocity gradient C [1/s], (particles, 3, 3)
    deformation  F [-], (particles, 3, 3)
    """

    position: Float[np.ndarray, "particles 3"]
    velocity: Float[np.ndarray, "particles 3"]
    affine: Float[np.ndarray, "particles 3 3"]
    deformation: Float[np.ndarray, "particles 3 3"]


class ClosedForm(ABC):
    """A body and its exact motion.

    box       the undeformed body
    duration  [s], divided into `frames` equal parts at whose ends the motion is compared
    """

    box: Box
    duration: float
    frames: int

    @abstractmethod
    def motion(self, points: Float[np.ndarray, "particles 3"], time: float) -> Motion:
        """The motion of the points [m] of the undeformed body at a time [s]."""


class AxialMotion(ClosedForm):
    """A bar that moves along x alone: x = X + u(X, t)."""

    largest_strain = 1e-3

    @abstractmethod
    def axial(self, along: Float[np.ndarray, " particles"], time: float) -> tuple[np.ndarray, ...]:
        """u [m], du/dX [-], du/dt [m/s], d^2u/(dX dt) [1/s] of points at X [m], each (particles,)."""

    @property
    def wave_speed(self) -> float:
        """c = sqrt(E / rho) [m/s]."""
        return math.sqrt(YOUNGS_MODULUS / DENSITY)

    def motion(self, points: Float[np.ndarray, "particles 3"], time: float) -> Motion:
        u, strain, speed, rate = self.axial(points[:, 0], time)
        position, velocity = points.copy(), np.zeros_like(points)
        position[:, 0] += u
        velocity[:, 0] = speed
        deformation, affine = np.tile(np.eye(3), (len(points), 1, 1)), np.zeros((len(points), 3, 3))
        deformation[:, 0, 0] += strain
        affine[:, 0, 0] = rate / (1.0 + strain)
        return Motion(position, velocity, affine, deformation)


class FreeBar(AxialMotion):
    """First axial vibration of a free bar of length L, over one period.

    u = A sin(omega t) sin(pi (X - X_middle) / L),   omega = (pi / L) sqrt(E / rho)
    """

    box = Box((0.2, 0.45, 0.45), (0.6, 0.1, 0.1))
    duration = 0.06
    frames = 5

    @property
    def wave_number(self) -> float:
        """pi / L [1/m]."""
        return math.pi / self.box.sides[0]

    @property
    def angular_frequency(self) -> float:
        """omega [rad/s]."""
        return self.wave_number * self.wave_speed

    def axial(self, along: Float[np.ndarray, " particles"], time: float) -> tuple[np.ndarray, ...]:
        k, omega = self.wave_number, self.angular_frequency
        arm = k * (along - self.box.middle[0])
        amplitude, turning = self.largest_strain / k, omega * time
        shape, slope = amplitude * np.sin(arm), self.largest_strain * np.cos(arm)
        sine, cosine = math.sin(turning), omega * math.cos(turning)
        return shape * sine, slope * sine, shape * cosine, slope * cosine


class TravellingWave(AxialMotion):
    """A plane wave u = A exp(-s^2 / 2), s = (X - X_0 - c t) / w, that stays away from the ends of a bar."""

    box = Box((0.1, 0.45, 0.45), (0.8, 0.1, 0.1))
    duration = 0.012
    frames = 2
    start = 0.38
    width = 0.06

    def axial(self, along: Float[np.ndarray, " particles"], time: float) -> tuple[np.ndarray, ...]:
        s = (along - self.start - self.wave_speed * time) / self.width
        # the slope A / w s exp(-s^2 / 2) is largest at s = 1
        u = self.largest_strain * self.width * math.exp(0.5) * np.exp(-0.5 * s**2)
        strain, bend = -s / self.width * u, (s**2 - 1.0) / self.width**2 * u
        return u, strain, -self.wave_speed * strain, -self.wave_speed * bend


class SteadyRotation(ClosedForm):
    """A flat box that turns about z, stretched by its own inertia.

    Without lateral contraction the axes of the turning body stretch on their own: E x'' + rho omega^2 x = 0 with free
    ends gives x = sin(k X) / (k cos(k L / 2)), k = omega sqrt(rho / E), along both edges L in the plane.
    """

    box = Box((0.35, 0.35, 0.45), (0.3, 0.3, 0.1))
    duration = 0.12
    frames = 4
    spin = 4.0

    def stretched(self, points: Float[np.ndarray, "particles 3"]) -> tuple[np.ndarray, np.ndarray]:
        """Arms of the stretched body before it turns [m], and the stretches along the axes [-], (particles, 3)."""
        arm, stretch = points - self.box.middle, np.ones_like(points)
        k = self.spin * math.sqrt(DENSITY / YOUNGS_MODULUS)
        for axis in (0, 1):
            at_end = math.cos(0.5 * k * self.box.sides[axis])
            stretch[:, axis] = np.cos(k * arm[:, axis]) / at_end
            arm[:, axis] = np.sin(k * arm[:, axis]) / (k * at_end)
        return arm, stretch

    def motion(self, points: Float[np.ndarray, "particles 3"], time: float) -> Motion:
        cosine, sine = math.cos(self.spin * time), math.sin(self.spin * time)
        turned = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        turning = self.spin * np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
        arm, stretch = self.stretched(points)
        arm = arm @ turned.T
        affine = np.tile(turning, (len(points), 1, 1))
        return Motion(self.box.middle + arm, arm @ turning.T, affine, turned * stretch[:, None])


CLOSED_FORMS: dict[str, ClosedForm] = {"bar": FreeBar(), "wave": TravellingWave(), "rotation": SteadyRotation()}
