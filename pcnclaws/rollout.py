"""Many steps of any simulator: recorded, watched for divergence, or differentiated through.

A step is a function from a state to the next one, so every simulator is run by the same code.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from pcnclaws.errors import SimulationDiverged
from pcnclaws.mpm.diagnostics import failing_particles, why_failing
from pcnclaws.mpm.state import ParticleState, Scenes
from pcnclaws.recompute import recomputed_step
from pcnclaws.simulator import Simulator, Step
from pcnclaws.tensor_types import Parameters


class Trajectory(NamedTuple):
    """What a run leaves: frames, and full states at the keyframes.

    step           step of each frame, (frames,), frame 0 is the start
    position       [m], (frames, 3, particles)
    velocity       [m/s], (frames, 3, particles)
    keyframe_step  step of each keyframe, (keyframes,), each of them also a frame
    affine         C [1/s], (keyframes, 3, 3, particles)
    deformation    F [-], (keyframes, 3, 3, particles)
    """

    step: Int64[Tensor, " frames"]
    position: Float[Tensor, "frames 3 particles"]
    velocity: Float[Tensor, "frames 3 particles"]
    keyframe_step: Int64[Tensor, " keyframes"]
    affine: Float[Tensor, "keyframes 3 3 particles"]
    deformation: Float[Tensor, "keyframes 3 3 particles"]


@torch.no_grad()
def simulate(
    step: Step,
    state: ParticleState,
    scenes: Scenes,
    steps: int,
    every: int = 1,
    keyframe_every: int = 0,
    scene_names: Sequence[str] | None = None,
    advice: str = "",
    progress: Callable[[int], None] | None = None,
) -> Trajectory:
    """Runs a simulator without gradients and records it.

    every           frames are kept at every `every`-th step
    keyframe_every  full states are kept at every `keyframe_every`-th step, 0 for none
    scene_names     names of the scenes for error messages
    advice          what the message of a divergence ends with, such as the time-step limit
    progress        called with the number of steps just done
    raises          SimulationDiverged, naming scene, step and particle, as soon as a frame is due
    """
    frames, keyframes = [(0, state.position, state.velocity)], [(0, state.affine, state.deformation)]
    checked, failed = state, failing_particles(state)
    for n in range(1, steps + 1):
        state = step(state)
        failed = failed | failing_particles(state)
        is_keyframe = keyframe_every > 0 and n % keyframe_every == 0
        is_frame = n % every == 0 or is_keyframe
        if is_frame or n == steps:
            # one look at the device per frame, not per step; the exact step is found again when it matters
            if bool(failed.any()):
                raise _divergence(step, checked, frames[-1][0], scenes, scene_names, advice)
            checked = state
        if is_frame:
            frames.append((n, state.position, state.velocity))
        if is_keyframe:
            keyframes.append((n, state.affine, state.deformation))
        if progress:
            progress(1)
    return _trajectory(frames, keyframes if keyframe_every > 0 else [], state)


def differentiable_rollout(
    simulator: Simulator,
    state: ParticleState,
    scenes: Scenes,
    parameters: Parameters,
    steps: int,
    every: int = 1,
    recompute: bool = True,
) -> Float[Tensor, "frames 3 particles"]:
    """Positions [m] after every `every`-th step (the start not included), with gradients of everything.

    recompute  keep only the state of each step (96 bytes a particle in float32) and compute the step again in the
               backward pass, so that memory grows with the state instead of with the graph; costs one more
               forward pass. First derivatives in reverse mode only: use False under forward-mode differentiation.
    """
    positions = []
    for n in range(1, steps + 1):
        if recompute and torch.is_grad_enabled():
            state = recomputed_step(simulator, state, scenes, parameters)
        else:
            state = simulator(state, scenes, parameters)
        if n % every == 0:
            positions.append(state.position)
    return torch.stack(positions)


def _divergence(
    step: Step, state: ParticleState, first: int, scenes: Scenes, scene_names: Sequence[str] | None, advice: str
) -> SimulationDiverged:
    """The error that names the first failing particle, found by running again from the last good state."""
    n = first
    while not bool((failing := failing_particles(state)).any()):
        state, n = step(state), n + 1
    particle = int(failing.nonzero()[0])
    scene = int(scenes.scene_index[particle])
    within = particle - int((scenes.scene_index < scene).sum())
    name = scene_names[scene] if scene_names else str(scene)
    ending = f"; {advice}" if advice else ""
    return SimulationDiverged(
        f"scene '{name}' diverged at step {n}: particle {within}: {why_failing(state, particle)}{ending}"
    )


def _trajectory(
    frames: list[tuple[int, Tensor, Tensor]], keyframes: list[tuple[int, Tensor, Tensor]], state: ParticleState
) -> Trajectory:
    steps, positions, velocities = zip(*frames, strict=True)
    matrices = state.affine.shape
    keyframe_steps, affines, deformations = zip(*keyframes, strict=True) if keyframes else ((), (), ())
    return Trajectory(
        torch.tensor(steps),
        torch.stack(positions),
        torch.stack(velocities),
        torch.tensor(keyframe_steps, dtype=torch.int64),
        torch.stack(affines) if affines else state.affine.new_zeros(0, *matrices),
        torch.stack(deformations) if deformations else state.deformation.new_zeros(0, *matrices),
    )
