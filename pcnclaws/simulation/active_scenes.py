"""Active-set batching: only scenes that need a step run, the others are in free fall or asleep."""

from collections.abc import Callable, Collection, Sequence
from typing import NamedTuple

import torch
from jaxtyping import Int64
from torch import Tensor

from pcnclaws.mpm.state import ParticleState, Scenes
from pcnclaws.simulation.batch import SceneBatch
from pcnclaws.simulation.free_fall import fallen
from pcnclaws.simulation.impulses import ImpulseSum
from pcnclaws.simulation.simulator import Step
from pcnclaws.tensors.tensor_types import Parameters

StepOf = Callable[[Scenes, Parameters], Step]


class SceneGroup(NamedTuple):
    """Some scenes of a batch as a batch of their own.

    numbers    their numbers in the whole batch, increasing
    particles  their particles' numbers in the whole batch, None where the group is the whole batch
    """

    numbers: tuple[int, ...]
    particles: Int64[Tensor, " particles"] | None
    scenes: Scenes
    parameters: Parameters

    def part_of(self, whole: ParticleState) -> ParticleState:
        """The state of the group's particles."""
        if self.particles is None:
            return whole
        return ParticleState(*(field.index_select(-1, self.particles) for field in whole))

    def put_into(self, whole: ParticleState, part: ParticleState) -> ParticleState:
        """The whole state with that of the group's particles replaced."""
        if self.particles is None:
            return part
        return ParticleState(*(a.index_copy(-1, self.particles, b) for a, b in zip(whole, part, strict=True)))


def group_of(scenes: Scenes, parameters: Parameters, numbers: Collection[int]) -> SceneGroup:
    """The scenes with these numbers."""
    chosen = tuple(sorted(numbers))
    if len(chosen) == scenes.scene_count:
        return SceneGroup(chosen, None, scenes, parameters)
    index = torch.tensor(chosen, dtype=torch.int64, device=scenes.scene_index.device)
    renumbered = scenes.scene_index.new_full((scenes.scene_count,), -1)
    renumbered[index] = torch.arange(len(chosen), device=index.device)
    scene_index = renumbered[scenes.scene_index]
    particles = (scene_index >= 0).nonzero()[:, 0]
    part = Scenes(
        scene_index[particles],
        scenes.mass[particles],
        scenes.volume[particles],
        scenes.gravity[:, index],
        scenes.load_shares[:, particles] if len(scenes.load_shares) else scenes.load_shares,
    )
    return SceneGroup(chosen, particles, part, {name: values[particles] for name, values in parameters.items()})


class ActiveScenes:
    """A batch under way: the scenes that run, with their state, and where the others are.

    step_of     makes the step of some scenes
    free_steps  steps after which each scene begins to run, in free fall until then
    impulses    is told which scenes run
    fallen_steps  steps of free fall that each scene has behind it since the state of the batch

    `n` is the step reached, `group` the scenes that run, `state` theirs, `step` their step, `joins` the steps after
    which scenes begin to run.
    """

    def __init__(
        self,
        step_of: StepOf,
        batch: SceneBatch,
        time_step: float,
        free_steps: Sequence[int],
        impulses: ImpulseSum | None = None,
        fallen_steps: Sequence[int] | None = None,
    ) -> None:
        self._step_of, self._scenes, self._parameters, self._time_step = step_of, *batch[1:3], time_step
        self._free_steps, self.impulses = list(free_steps), impulses
        self.joins = frozenset(free_steps)
        # where scenes that do not run began to fall, or came to rest
        self._idle = batch.state
        self._left: set[int] = set()
        self.n = 0
        self._fallen = [0] * batch.scenes.scene_count if fallen_steps is None else list(fallen_steps)
        falls_on = any(self._fallen)
        self._regroup(fallen(batch.state, self._scenes, time_step, self._fallen) if falls_on else batch.state)

    @property
    def any_running(self) -> bool:
        """Whether a step is needed now."""
        return bool(self.group.numbers)

    def whole(self) -> ParticleState:
        """The state of all scenes at step n."""
        if self.group.particles is None:
            return self.state
        falling = enumerate(zip(self._fallen, self._free_steps, strict=True))
        counts = [0 if k in self._left else before + min(self.n, free) for k, (before, free) in falling]
        return self.group.put_into(fallen(self._idle, self._scenes, self._time_step, counts), self.state)

    def reached(self, n: int, state: ParticleState) -> None:
        """Takes the state of the running scenes at step n; scenes whose free fall ends there begin to run."""
        self.n, self.state = n, state
        if n in self.joins:
            self._regroup(self.whole())

    def leave(self, numbers: Collection[int]) -> None:
        """Lets scenes stay as they are now."""
        if not numbers:
            return
        whole = self.whole()
        leaving = group_of(self._scenes, self._parameters, numbers)
        self._idle = leaving.put_into(self._idle, leaving.part_of(whole))
        self._left |= set(numbers)
        self._regroup(whole)

    def _regroup(self, whole: ParticleState) -> None:
        running = [k for k, free in enumerate(self._free_steps) if free <= self.n and k not in self._left]
        self.group = group_of(self._scenes, self._parameters, running)
        self.state = self.group.part_of(whole)
        self.step = self._step_of(self.group.scenes, self.group.parameters)
        if self.impulses is not None:
            self.impulses.numbers = self.group.numbers
