"""Free fall without a step: the discrete motion of a stress-free body before its first contact is known.

A body with F = I, C = 0 and one velocity stays so until a wall acts on it: it has no stress, the grid interpolates
its one velocity exactly, and gravity adds the same to every node.
"""

import math
from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Bool, Float, Int64
from torch import Tensor
from torch.autograd import forward_ad

from pcnclaws.laws.internal_variables import start_values
from pcnclaws.mpm.contact import VERSION_1_STICK
from pcnclaws.mpm.grid import grid_of
from pcnclaws.mpm.settings import DISTANCE_TOLERANCE, SimulationSettings
from pcnclaws.mpm.state import ParticleState, Scenes
from pcnclaws.simulation.collider_distance import steps_before_colliders
from pcnclaws.simulation.simulator import Simulator
from pcnclaws.simulation.stress_free import is_stress_free_at_rest
from pcnclaws.tensors.tensor_types import Parameters

# A particle exchanges with the nodes up to this many cells away.
REACH = 1.5


def free_steps(
    simulator: Simulator, state: ParticleState, scenes: Scenes, parameters: Parameters, steps: int
) -> list[int]:
    """How many of the next steps each scene stays in free fall.

    0 for a scene that spins, is deformed, has stress at F = I, bears loads, or touches a wall that it moves into or a
    collider; also where velocity, C, F or internal variables carry derivatives, since a change of them would end it.
    """
    settings = simulator.integrator.settings
    if settings.loads or any(map(_carries_derivative, state[1:])):
        return [0] * scenes.scene_count
    first = _first_particles(scenes)
    falls = _moves_as_one(state, scenes, first)
    if simulator.internal_variables:
        changed = (state.internal != start_values(simulator.internal_variables, state.position)).any(0)
        falls = falls & ~torch.zeros_like(falls).index_put((scenes.scene_index,), changed, accumulate=True)
    falls = falls.tolist()
    of_scenes = {name: values[first] for name, values in parameters.items()}
    if not any(falls) or not is_stress_free_at_rest(simulator, of_scenes):
        return [0] * scenes.scene_count
    lower, upper = _extreme(state.position, scenes, "amin"), _extreme(state.position, scenes, "amax")
    # a list first: under torch.func a tensor does not give away its memory
    motion = np.array(torch.stack((lower, upper, state.velocity[:, first], scenes.gravity)).tolist())
    free = [
        _steps_before_contact(motion[:, :, scene], settings, steps) if falls[scene] else 0
        for scene in range(scenes.scene_count)
    ]
    if not settings.colliders:
        return free
    index = scenes.scene_index
    return [
        steps_before_colliders(state.position[:, index == scene], motion[2:, :, scene], settings, count)
        for scene, count in enumerate(free)
    ]


def fallen(state: ParticleState, scenes: Scenes, time_step: float, counts: Sequence[int]) -> ParticleState:
    """The state after `counts` steps of free fall, one number for each scene.

        v_n = v_0 + n dt g,   x_n = x_0 + n dt v_0 + dt^2 n (n + 1) / 2 g

    The second is the sum of the steps x_n = x_(n-1) + dt v_n.
    """
    n = np.asarray(counts, dtype=np.float64)
    time, half_square = (
        torch.as_tensor(values, dtype=state.position.dtype, device=state.position.device)
        for values in (time_step * n, time_step**2 * n * (n + 1.0) / 2.0)
    )
    index = scenes.scene_index
    position = state.position + time[index] * state.velocity + (half_square * scenes.gravity)[:, index]
    return state._replace(position=position, velocity=state.velocity + (time * scenes.gravity)[:, index])


def _steps_before_contact(motion: Float[np.ndarray, "4 3"], settings: SimulationSettings, steps: int) -> int:
    """Steps before a body meets a wall that opposes its motion, or leaves the domain.

    One step less than that, so that the rounding of a position never decides.
    motion  lower and upper corner of the body [m], its velocity [m/s], gravity [m/s^2]
    """
    lower, upper, velocity, gravity = motion
    n, dt = np.arange(steps + 1, dtype=np.float64)[:, None], settings.time_step
    path = n * dt * velocity + (dt**2 * n * (n + 1.0) / 2.0) * gravity
    after = velocity + (n + 1.0) * dt * gravity
    last_wall_node = math.floor(settings.wall_distance * grid_of(settings).per_metre + DISTANCE_TOLERANCE)
    felt = settings.within((last_wall_node + REACH) * settings.grid_spacing)
    limits = settings.within(0.0)
    low, high = lower + path, upper + path
    near_low, near_high = low <= felt[0], high >= felt[1]
    if settings.boundary in ("separate", VERSION_1_STICK):  # which let go
        near_low, near_high = near_low & (after < 0.0), near_high & (after > 0.0)
    # written so that a position that is not a number is not free
    free = ((low >= limits[0]) & (high <= limits[1]) & ~near_low & ~near_high).all(1)
    return steps if free.all() else max(int(np.argmin(free)) - 1, 0)


def _moves_as_one(state: ParticleState, scenes: Scenes, first: Int64[Tensor, " scenes"]) -> Bool[Tensor, " scenes"]:
    """Scenes that start as one undeformed body (or several) of one velocity."""
    same = (state.velocity == state.velocity[:, first][:, scenes.scene_index]).all(0)
    undeformed = (state.deformation == torch.eye(3, device=state.position.device)[:, :, None]).all(0).all(0)
    other = ~(same & undeformed & (state.affine == 0.0).all(0).all(0))
    return torch.zeros_like(first).index_add(0, scenes.scene_index, other.long()) == 0


def _carries_derivative(field: Tensor) -> bool:
    """Whether a gradient (reverse mode) or a tangent (forward mode) belongs to the field."""
    return (field.requires_grad and torch.is_grad_enabled()) or forward_ad.unpack_dual(field).tangent is not None


def _first_particles(scenes: Scenes) -> Int64[Tensor, " scenes"]:
    """The first particle of each scene."""
    particles = torch.arange(len(scenes.scene_index), device=scenes.scene_index.device)
    start = particles.new_full((scenes.scene_count,), len(particles) - 1)
    return start.scatter_reduce(0, scenes.scene_index, particles, "amin")


def _extreme(position: Tensor, scenes: Scenes, which: str) -> Float[Tensor, "3 scenes"]:
    """Smallest ('amin') or largest ('amax') coordinates of each scene [m]; NaN where one is."""
    result = position.new_zeros(3, scenes.scene_count)
    index = scenes.scene_index.expand_as(position)
    return result.scatter_reduce(1, index, position.detach(), which, include_self=False)
