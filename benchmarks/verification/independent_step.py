"""One step of the Material Point Method in NumPy, written for the energies that leave in it, apart from the package's.

Steps 2 to 4 of docs/conventions.md, "One step", with a floor that only pushes.
"""

from typing import NamedTuple

import numpy as np


class Particles(NamedTuple):
    """Position [m], velocity [m/s], affine velocity C [1/s], each particle first, and mass [kg] and volume [m^3]."""

    position: np.ndarray
    velocity: np.ndarray
    affine: np.ndarray
    mass: float
    volume: float

    def kinetic_energy(self, spacing: float) -> float:
        """Of the velocities, and (dx^2 / 4) |C|^2 of what is affine in a cell [J]."""
        affine = 0.25 * spacing**2 * np.square(self.affine).sum()
        return float(0.5 * self.mass * (np.square(self.velocity).sum() + affine))


class Grid(NamedTuple):
    """dx [m], time step [s], gravity [m/s^2] along y, and the height of the highest nodes of the floor [m]."""

    spacing: float
    time_step: float
    gravity: float
    floor: float


class Step(NamedTuple):
    """Particles after it, and the energy that was lost in it [J].

    transfers  from particles to the grid and back
    floor      work against its forces, with the mean of the velocities before and after
    stepping   of forces that are those of the start while positions move with the velocities of the end
    """

    particles: Particles
    transfers: float
    floor: float
    stepping: float


def step(before: Particles, stress: np.ndarray, grid: Grid) -> Step:
    """One step with the Kirchhoff stresses [Pa] of the particles, (particles, 3, 3)."""
    dx, dt = grid.spacing, grid.time_step
    base = np.floor(before.position / dx - 0.5).astype(int)
    weights = _weights(before.position / dx - base)
    low, shape = base.min(0), base.max(0) - base.min(0) + 3
    mass, momentum, push = np.zeros(shape), np.zeros((*shape, 3)), np.zeros((*shape, 3))
    nodes = []
    for offset in np.ndindex(3, 3, 3):
        weight = np.prod([weights[axis][:, offset[axis]] for axis in range(3)], axis=0)
        arm = (base + offset) * dx - before.position
        node = tuple((base - low + offset).T)
        nodes.append((node, weight, arm))
        np.add.at(mass, node, before.mass * weight)
        carried = before.velocity + np.einsum("pij,pj->pi", before.affine, arm)
        np.add.at(momentum, node, before.mass * weight[:, None] * carried)
        force = -before.volume * 4.0 / dx**2 * np.einsum("pij,pj->pi", stress, arm)
        np.add.at(push, node, weight[:, None] * force)
    there = mass > 0.0
    inverse = np.where(there, 1.0 / np.where(there, mass, 1.0), 0.0)[..., None]
    start = momentum * inverse
    pushed = start + dt * push * inverse + np.where(there[..., None], [0.0, dt * grid.gravity, 0.0], 0.0)
    end = pushed.copy()
    blocked = (np.arange(shape[1]) + low[1]) * dx <= grid.floor + 1e-6 * dx
    end[:, blocked, :, 1] = np.maximum(end[:, blocked, :, 1], 0.0)
    velocity, affine = np.zeros_like(before.velocity), np.zeros_like(before.affine)
    for node, weight, arm in nodes:
        velocity += weight[:, None] * end[node]
        affine += 4.0 / dx**2 * weight[:, None, None] * end[node][:, :, None] * arm[:, None, :]
    after = before._replace(position=before.position + dt * velocity, velocity=velocity, affine=affine)

    def energy(speeds: np.ndarray) -> float:
        return float(0.5 * (mass[..., None] * np.square(speeds)).sum())

    transfers = before.kinetic_energy(dx) - energy(start) + energy(end) - after.kinetic_energy(dx)
    given = mass[..., None] * (pushed - start)
    taken = mass[..., None] * (pushed - end)
    floor, stepping = 0.5 * (taken * (start + end)).sum(), 0.5 * (given * (end - start)).sum()
    return Step(after, transfers, float(floor), float(stepping))


def _weights(place: np.ndarray) -> list[np.ndarray]:
    """Quadratic B-splines of three nodes along each axis, (particles, 3) each; place in cells from the first node."""
    return [np.stack([0.5 * (1.5 - x) ** 2, 0.75 - (x - 1.0) ** 2, 0.5 * (x - 0.5) ** 2], axis=1) for x in place.T]
