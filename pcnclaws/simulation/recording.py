"""Recording of a run: frames, and restart states at the keyframes."""

from typing import NamedTuple

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from pcnclaws.mpm.state import ParticleState
from pcnclaws.simulation.impulses import ImpulseSum


class Trajectory(NamedTuple):
    """What a run leaves: frames, and full states at the keyframes.

    step               step of each frame, (frames,), frame 0 is the start
    position           [m], (frames, 3, particles)
    velocity           [m/s], (frames, 3, particles), no frames where they were not asked for
    keyframe_step      step of each keyframe, (keyframes,), each of them also a frame
    affine             C [1/s], (keyframes, 3, 3, particles)
    deformation        F [-], (keyframes, 3, 3, particles)
    keyframe_velocity  [m/s], (keyframes, 3, particles)
    internal           internal variables, (keyframes, variables, particles)
    impulses           of colliders since the start [N s], (frames, scenes, colliders, 3)
    """

    step: Int64[Tensor, " frames"]
    position: Float[Tensor, "frames 3 particles"]
    velocity: Float[Tensor, "velocities 3 particles"]
    keyframe_step: Int64[Tensor, " keyframes"]
    affine: Float[Tensor, "keyframes 3 3 particles"]
    deformation: Float[Tensor, "keyframes 3 3 particles"]
    keyframe_velocity: Float[Tensor, "keyframes 3 particles"]
    internal: Float[Tensor, "keyframes variables particles"]
    impulses: Float[Tensor, "frames scenes colliders 3"]


class FramePlan(NamedTuple):
    """Which steps of a run are kept.

    every           frames are kept at every `every`-th step
    keyframe_every  full states are kept at every `keyframe_every`-th step, 0 for none
    velocities      velocities are kept at the frames, too
    start_state     a full state is kept of the start, if of no other step
    """

    steps: int
    every: int = 1
    keyframe_every: int = 0
    velocities: bool = False
    start_state: bool = False

    @property
    def keyframes(self) -> list[int]:
        """Steps of the keyframes."""
        if self.keyframe_every > 0:
            return list(range(0, self.steps + 1, self.keyframe_every))
        return [0] if self.start_state else []

    @property
    def frames(self) -> list[int]:
        """Steps of the frames, those of the keyframes among them."""
        return sorted({*range(0, self.steps + 1, self.every), *self.keyframes})


class Recording:
    """Room for the frames of a run, filled one after the other.

    everything  keep velocity, C and F of every frame, asked for or not
    impulses    the sum of impulses of which the frames are kept, too; None without colliders
    """

    def __init__(
        self, plan: FramePlan, like: ParticleState, everything: bool = False, impulses: ImpulseSum | None = None
    ) -> None:
        self.plan, self._sum = plan, ImpulseSum(0, 0) if impulses is None else impulses
        self._row = {n: row for row, n in enumerate(plan.frames)}
        full = plan.frames if everything else plan.keyframes
        self._full_row = {n: row for row, n in enumerate(full)}
        velocities = len(plan.frames) if plan.velocities or everything else 0
        self._position = like.position.new_empty(len(plan.frames), *like.position.shape)
        self._velocity = like.velocity.new_empty(velocities, *like.velocity.shape)
        self._full = [field.new_empty(len(full), *field.shape) for field in like[1:]]
        self._impulses = self._sum.total.new_empty(len(plan.frames), *self._sum.total.shape)

    def put(self, n: int, state: ParticleState) -> None:
        """Keeps what is asked for of the state at one of the frames."""
        row = self._row[n]
        self._position[row] = state.position.detach()
        self._impulses[row] = self._sum.total
        if len(self._velocity):
            self._velocity[row] = state.velocity.detach()
        if n in self._full_row:
            for kept, field in zip(self._full, state[1:], strict=True):
                kept[self._full_row[n]] = field.detach()

    def trajectory(self) -> Trajectory:
        """The frames, once all are put."""
        keyframes, full = self.plan.keyframes, self._full
        if len(full[0]) > len(keyframes):  # more than asked for
            rows = [self._full_row[n] for n in keyframes]
            full = [field[rows] for field in full]
        velocity, affine, deformation, internal = full
        step, keyframe_step = (torch.tensor(steps, dtype=torch.int64) for steps in (self.plan.frames, keyframes))
        return Trajectory(
            step=step,
            position=self._position,
            velocity=self._velocity,
            keyframe_step=keyframe_step,
            affine=affine,
            deformation=deformation,
            keyframe_velocity=velocity,
            internal=internal,
            impulses=self._impulses,
        )
