"""How far bodies are from colliders: for free fall, starts, and the speed at contact."""

import math

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from pcnclaws.mpm.colliders import Collider
from pcnclaws.mpm.distance_fields import SignedDistance
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.tensors.tensor_types import Vectors

# A particle exchanges with nodes up to 1.5 cells away along each axis.
REACH = 1.5 * math.sqrt(3.0)
# So many particles stand for a body whose fall is followed, and so many cells long are its paces at least.
FOLLOWED, PACES = 200, 1000


@torch.no_grad()
def steps_before_colliders(
    position: Vectors, motion: Float[np.ndarray, "2 3"], settings: SimulationSettings, steps: int
) -> int:
    """Steps of free fall before a body may touch a collider, at most `steps`.

    position  of its particles at the start [m]
    motion    velocity [m/s] and gravity [m/s^2]
    """
    if any(isinstance(collider.shape, SignedDistance) for collider in settings.colliders):
        return 0  # who knows whether it is a distance
    points, dt = position.detach().double(), settings.time_step
    velocity, gravity = (torch.from_numpy(vector.copy()).to(points)[:, None] for vector in motion)
    n = 0
    while n < steps:
        fallen = points + n * dt * velocity + (dt**2 * n * (n + 1) / 2.0) * gravity
        room = _room(fallen, settings, settings.time_at(n))
        if room <= 0.0:
            return max(n - 1, 0)
        # no faster than this in the rest of the run
        fastest = float(velocity.norm() + steps * dt * gravity.norm()) + _collider_speed(settings, fallen)
        n += max(int(room / max(fastest * dt, 1e-300)), 1)
    return steps


def collider_distance(
    collider: Collider, position: Float[np.ndarray, "particles 3"], time: float
) -> Float[np.ndarray, " particles"]:
    """Signed distance of particles from a collider at a time [s] in [m], (particles,)."""
    with torch.no_grad():
        return collider.distance(torch.tensor(position.T, dtype=torch.float64), time)[0].numpy()


@torch.no_grad()
def fall_to_colliders(position: Float[np.ndarray, "particles 3"], settings: SimulationSettings) -> float:
    """Height of the fall along gravity until a particle meets a collider, where it is at the start [m]; or infinite."""
    gravity = torch.tensor(settings.gravity, dtype=torch.float64)
    sample = position[:: -(-len(position) // FOLLOWED)]
    points = torch.tensor(sample.T, dtype=torch.float64)
    down = (gravity / gravity.norm())[:, None]
    least = math.inf
    for collider in settings.colliders:
        fallen = torch.zeros(points.shape[1], dtype=torch.float64)
        for _ in range(PACES):
            distance = collider.distance(points + fallen * down, settings.start_time)[0]
            if bool((distance <= settings.grid_spacing).any()):
                least = min(least, float(fallen[distance <= settings.grid_spacing].min()) + settings.grid_spacing)
                break
            fallen = fallen + distance.clamp_min(settings.grid_spacing)
    return least


def collider_speed(settings: SimulationSettings, position: Float[np.ndarray, "particles 3"]) -> float:
    """The largest speed of colliders near a body [m/s]."""
    return _collider_speed(settings, torch.tensor(position.T, dtype=torch.float64))


def _collider_speed(settings: SimulationSettings, points: Tensor) -> float:
    speeds = [0.0]
    for collider in settings.colliders:
        reach = (points - collider.shape.pivot(points)[:, None]).norm(dim=0).max()
        speeds.append(collider.speed(float(reach)))
    return max(speeds)


def _room(points: Tensor, settings: SimulationSettings, time: float) -> float:
    """How far all particles are from what the colliders act on [m]."""
    distances = [collider.distance(points, max(time, collider.start))[0].min() for collider in settings.colliders]
    return float(torch.stack(distances).min()) - (REACH + 1e-3) * settings.grid_spacing
