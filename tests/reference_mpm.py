"""An independent material point method in float64 NumPy, one particle after the other.

It is written from the physics conventions alone, shares no code with the package, and takes the slow, obvious road
everywhere: a singular value decomposition per particle, a dense grid, explicit loops. Arrays are particle-first.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import floor, log, pi, sin, sqrt

import numpy as np

from pcnclaws.mpm.contact import VERSION_1_STICK

IDENTITY = np.eye(3)
MARGIN = 2  # extra grid nodes on each side, so that every stencil of a particle in the domain fits


@dataclass(frozen=True)
class Settings:
    """The domain is [0, 1]^3 m; `wall_distance` [m], `time_step` [s], `gravity` [m/s^2], `boundary` of two contacts."""

    time_step: float
    grid_nodes: int
    wall_distance: float
    gravity: tuple[float, float, float]
    boundary: str


@dataclass
class Body:
    """Particles: position, velocity (P, 3) [m, m/s], affine, deformation (P, 3, 3), mass, volume (P,) [kg, m^3]."""

    position: np.ndarray
    velocity: np.ndarray
    affine: np.ndarray
    deformation: np.ndarray
    mass: np.ndarray
    volume: np.ndarray


def body_at_rest_shape(position: np.ndarray, velocity: np.ndarray, mass: np.ndarray, volume: np.ndarray) -> Body:
    """A body with F = I and C = 0."""
    count = len(position)
    return Body(
        position.copy(), velocity.copy(), np.zeros((count, 3, 3)), np.tile(IDENTITY, (count, 1, 1)), mass, volume
    )


def lame(parameters: Mapping[str, float]) -> tuple[float, float]:
    """Lame constants (lambda, mu) [Pa] of Young's modulus [Pa] and Poisson's ratio."""
    youngs, poisson = parameters["youngs_modulus"], parameters["poissons_ratio"]
    return youngs * poisson / ((1 + poisson) * (1 - 2 * poisson)), youngs / (2 * (1 + poisson))


def fixed_corotated(deformation: np.ndarray, parameters: Mapping[str, float]) -> np.ndarray:
    """tau = 2 mu (F - R) F^T + lambda J (J - 1) I."""
    lam, mu = lame(parameters)
    left, _, right = np.linalg.svd(deformation)
    volume_ratio = np.linalg.det(deformation)
    rotation = left @ right
    return 2 * mu * (deformation - rotation) @ deformation.T + lam * volume_ratio * (volume_ratio - 1) * IDENTITY


def stvk_hencky(deformation: np.ndarray, parameters: Mapping[str, float]) -> np.ndarray:
    """tau = 2 mu h + lambda tr(h) I with h = 1/2 log(F F^T), on the principal axes."""
    lam, mu = lame(parameters)
    left, stretches, _ = np.linalg.svd(deformation)
    strain = np.log(stretches)
    return left @ np.diag(2 * mu * strain + lam * strain.sum()) @ left.T


def neo_hookean(deformation: np.ndarray, parameters: Mapping[str, float]) -> np.ndarray:
    """tau = mu (F F^T - I) + lambda ln(J) I."""
    lam, mu = lame(parameters)
    return mu * (deformation @ deformation.T - IDENTITY) + lam * log(np.linalg.det(deformation)) * IDENTITY


def no_plasticity(trial: np.ndarray, parameters: Mapping[str, float]) -> np.ndarray:
    """The trial deformation itself."""
    return trial


def drucker_prager(trial: np.ndarray, parameters: Mapping[str, float]) -> np.ndarray:
    """Return to the Drucker-Prager cone; an expansion returns to h = 0."""
    lam, mu = lame(parameters)
    sine = sin(parameters["friction_angle"] * pi / 180)
    alpha = sqrt(2 / 3) * 2 * sine / (3 - sine)
    left, stretches, right = np.linalg.svd(trial)
    strain = np.log(stretches)
    trace = strain.sum()
    if trace > 0:
        return left @ right
    deviator = strain - trace / 3
    excess = np.linalg.norm(deviator) + (3 * lam + 2 * mu) / (2 * mu) * trace * alpha
    return _shrunk(left, strain, deviator, excess, right)


def von_mises(trial: np.ndarray, parameters: Mapping[str, float]) -> np.ndarray:
    """Return to the von Mises cylinder |dev tau| <= tau_Y."""
    _, mu = lame(parameters)
    left, stretches, right = np.linalg.svd(trial)
    strain = np.log(stretches)
    deviator = strain - strain.sum() / 3
    excess = np.linalg.norm(deviator) - parameters["yield_stress"] / (2 * mu)
    return _shrunk(left, strain, deviator, excess, right)


def tresca(trial: np.ndarray, parameters: Mapping[str, float]) -> np.ndarray:
    """Return to the Tresca prism tau_1 - tau_3 <= sqrt(2) tau_Y: to a face, or to one of its two corners."""
    _, mu = lame(parameters)
    left, stretches, right = np.linalg.svd(trial)  # in descending order
    strain = np.log(stretches)
    mean = strain.sum() / 3
    first, second, third = strain - mean
    limit = sqrt(2) * parameters["yield_stress"] / (2 * mu)
    excess = first - third - limit
    if excess > 0:
        if first - excess / 2 < second:
            strain = mean + np.array((limit / 3, limit / 3, -2 * limit / 3))
        elif third + excess / 2 > second:
            strain = mean + np.array((2 * limit / 3, -limit / 3, -limit / 3))
        else:
            strain = strain + np.array((-excess / 2, 0, excess / 2))
    return left @ np.diag(np.exp(strain)) @ right


def _shrunk(
    left: np.ndarray, strain: np.ndarray, deviator: np.ndarray, excess: float | np.floating, right: np.ndarray
) -> np.ndarray:
    if excess > 0:
        strain = strain - excess * deviator / np.linalg.norm(deviator)
    return left @ np.diag(np.exp(strain)) @ right


LAWS = {
    "elasticity": (fixed_corotated, no_plasticity),
    "plasticine": (stvk_hencky, von_mises),
    "sand": (stvk_hencky, drucker_prager),
    "neo_hookean": (neo_hookean, no_plasticity),
    "tresca": (stvk_hencky, tresca),
}


def stencil(position: np.ndarray, spacing: float) -> tuple[tuple[slice, slice, slice], np.ndarray, np.ndarray]:
    """The 27 nodes around a particle: where they are in the grid, weights (27, 1), vectors to them (27, 3) [m]."""
    slices, weights, offsets = [], [], []
    for x in position.tolist():
        first = floor(x / spacing - 0.5)
        nodes = range(first, first + 3)
        slices.append(slice(first + MARGIN, first + MARGIN + 3))
        weights.append([spline(x / spacing - node) for node in nodes])
        offsets.append([node * spacing - x for node in nodes])
    weight = np.array([[x * y * z] for x in weights[0] for y in weights[1] for z in weights[2]])
    offset = np.array([[x, y, z] for x in offsets[0] for y in offsets[1] for z in offsets[2]])
    return (slices[0], slices[1], slices[2]), weight, offset


def spline(distance: float) -> float:
    """Quadratic B-spline at a distance in units of the grid spacing."""
    distance = abs(distance)
    if distance < 0.5:
        return 0.75 - distance**2
    if distance < 1.5:
        return 0.5 * (1.5 - distance) ** 2
    return 0.0


def meet_walls(velocity: np.ndarray, settings: Settings) -> None:
    """Takes from the grid velocity what points into a wall (separate), or all of it at such a node (stick)."""
    near = settings.wall_distance * settings.grid_nodes + 1e-6  # in nodes, with a tolerance
    into = np.zeros(velocity.shape, dtype=bool)
    for axis in range(3):
        for index in range(velocity.shape[axis]):
            node = index - MARGIN
            layer = tuple(index if a == axis else slice(None) for a in range(3))
            if node <= near:
                into[(*layer, axis)] |= velocity[(*layer, axis)] < 0
            if settings.grid_nodes - node <= near:
                into[(*layer, axis)] |= velocity[(*layer, axis)] > 0
    if settings.boundary == VERSION_1_STICK:
        into[into.any(-1)] = True
    velocity[into] = 0.0


def step(body: Body, material: str, parameters: Mapping[str, float], settings: Settings) -> Body:
    """One time step: stress, particles to grid, gravity and walls, grid to particles, trial F, plasticity."""
    elasticity, plasticity = LAWS[material]
    dt, spacing = settings.time_step, 1.0 / settings.grid_nodes
    inertia = 4.0 / spacing**2
    edge = settings.grid_nodes + 1 + 2 * MARGIN
    mass, momentum = np.zeros((edge, edge, edge)), np.zeros((edge, edge, edge, 3))
    stencils = [stencil(position, spacing) for position in body.position]
    for p, (nodes, weight, offset) in enumerate(stencils):
        stress = elasticity(body.deformation[p], parameters)
        drive = body.mass[p] * body.affine[p] - dt * body.volume[p] * inertia * stress
        mass[nodes] += (weight * body.mass[p]).reshape(3, 3, 3)
        momentum[nodes] += (weight * (body.mass[p] * body.velocity[p] + offset @ drive.T)).reshape(3, 3, 3, 3)
    velocity = np.zeros_like(momentum)
    occupied = mass > 0
    velocity[occupied] = momentum[occupied] / mass[occupied][:, None] + dt * np.array(settings.gravity)
    meet_walls(velocity, settings)
    position, moved = body.position.copy(), np.zeros_like(body.velocity)
    affine, deformation = np.zeros_like(body.affine), body.deformation.copy()
    for p, (nodes, weight, offset) in enumerate(stencils):
        weighted = weight * velocity[nodes].reshape(27, 3)
        moved[p] = weighted.sum(0)
        affine[p] = inertia * weighted.T @ offset
        position[p] += dt * moved[p]
        deformation[p] = plasticity((IDENTITY + dt * affine[p]) @ deformation[p], parameters)
    return Body(position, moved, affine, deformation, body.mass, body.volume)


def simulate(body: Body, material: str, parameters: Mapping[str, float], settings: Settings, steps: int) -> Body:
    """The body after so many steps."""
    for _ in range(steps):
        body = step(body, material, parameters, settings)
    return body
