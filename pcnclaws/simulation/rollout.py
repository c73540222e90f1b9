"""Rollouts of any simulator: recorded and checked for divergence, or differentiated through.

A step is a function from a state to the next one, so every simulator is run by the same code. Scenes of a batch that
need no step are left out of it (active_scenes.py).
"""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from pcnclaws.errors import ParticleEscaped, SimulationDiverged
from pcnclaws.guards import count as count_guard
from pcnclaws.mpm.settings import UNIT_BOX, Domain
from pcnclaws.mpm.state import ParticleState, Scenes
from pcnclaws.simulation.active_scenes import ActiveScenes
from pcnclaws.simulation.at_rest import RestWatch
from pcnclaws.simulation.batch import SceneBatch
from pcnclaws.simulation.cuda_graphs import advanced, differentiable_steps, records_steps
from pcnclaws.simulation.execution import Progress
from pcnclaws.simulation.fast_paths import Skips
from pcnclaws.simulation.free_fall import free_steps
from pcnclaws.simulation.gradient_checkpointing import recomputed_step
from pcnclaws.simulation.impulses import ImpulseSum
from pcnclaws.simulation.physical_states import failing_particles, left_domain, why_failing
from pcnclaws.simulation.recording import FramePlan, Recording, Trajectory
from pcnclaws.simulation.simulator import Simulator, Step
from pcnclaws.tensors.tensor_types import ParticleMask

# Above this many particle-steps the graph of a differentiable rollout is not kept but computed again. A step keeps some
# 5 kB a particle in PyTorch; compiled, 0.2 kB, which is not much more than its state.
MOST_PARTICLE_STEPS = 100_000
MOST_COMPILED_PARTICLE_STEPS = 3_000_000


@torch.no_grad()
def simulate(
    step: Step,
    state: ParticleState,
    scenes: Scenes,
    steps: int,
    every: int = 1,
    *,
    keyframe_every: int = 0,
    scene_names: Sequence[str] | None = None,
    advice: str = "",
    progress: Progress | None = None,
    limits: Domain = UNIT_BOX,
) -> Trajectory:
    """Runs any step function without gradients and records it, velocities at the frames among it; skips nothing.

    every           frames are kept at every `every`-th step
    keyframe_every  full states are kept at every `keyframe_every`-th step, 0 for none
    scene_names     names of the scenes for error messages
    advice          what the message of a divergence ends with, such as the time-step limit
    progress        called with the number of steps just done
    limits          SimulationSettings.limits, between which particles may be
    raises          SimulationDiverged, naming scene, step and particle, as soon as a frame is due
    """
    run = ActiveScenes(lambda *_: step, SceneBatch(state, scenes, {}), 0.0, [0] * scenes.scene_count)
    recording = Recording(FramePlan(steps, every, keyframe_every, velocities=True), state)
    return _run(run, recording, None, _Report(scene_names, advice, progress, limits))


@torch.no_grad()
def simulate_scenes(
    simulator: Simulator,
    batch: SceneBatch,
    plan: FramePlan,
    skips: Skips | None = None,
    progress: Progress | None = None,
    fallen_steps: Sequence[int] | None = None,
) -> Trajectory:
    """Runs the scenes of a batch without gradients, each one only while it needs steps, and records them.

    plan          the number of steps and what is kept of them
    skips         what is left out, everything by default
    progress      called with the number of steps just done
    fallen_steps  steps of free fall that each scene has behind it since the state of the batch
    raises        SimulationDiverged, naming scene, step and particle, as soon as a frame is due
    """
    skips = skips or Skips()
    settings = simulator.integrator.settings
    batch = batch._replace(state=simulator.started(batch.state))
    before = [0] * batch.scenes.scene_count if fallen_steps is None else fallen_steps
    free = _free_steps(simulator, batch, plan.steps + max(before), skips)
    free = [min(max(n - gone, 0), plan.steps) for n, gone in zip(free, before, strict=True)]
    impulses = ImpulseSum(batch.scenes.scene_count, len(settings.colliders)) if settings.colliders else None
    step_of = partial(simulator.step_function, take_impulses=impulses.take if impulses else None)
    run = ActiveScenes(step_of, batch, settings.time_step, free, impulses=impulses, fallen_steps=before)
    recording = Recording(plan, batch.state, not skips.history, impulses)
    # what changes with time may wake a scene that rests
    rests = skips.rest and not (settings.changes or simulator.takes_time)
    watch = RestWatch(settings, plan.steps) if rests else None
    return _run(run, recording, watch, _Report(batch.names or None, "", progress, settings.limits), simulator)


@torch.no_grad()
def state_after(simulator: Simulator, batch: SceneBatch, steps: int) -> ParticleState:
    """The state `steps` steps later: every step is run, without a graph, and nobody looks whether it is physical."""
    state, scenes, parameters, _ = batch
    state = simulator.started(state)
    if records_steps(simulator, state, scenes):
        return advanced(simulator, state, scenes, parameters, steps)[0]
    step = simulator.step_function(scenes, parameters)
    for n in range(steps):
        state = step(state, n)
    return state


def differentiable_rollout(
    simulator: Simulator,
    batch: SceneBatch,
    steps: int,
    every: int = 1,
    *,
    recompute: bool | None = None,
    skips: Skips | None = None,
) -> Float[Tensor, "frames 3 particles"]:
    """Positions [m] after every `every`-th step (the start not included), with gradients of everything.

    recompute  keep only the state of each step (96 bytes a particle in float32) and compute the step again in the
               backward pass, so that memory grows with the state instead of with the graph; costs one more
               forward pass. First derivatives in reverse mode only: use False under forward-mode differentiation.
               None does so in long rollouts of many particles.
    skips      what is left out, all that is exact by default: the last step is always run, so that a gradient of
               every input exists
    """
    at = range(every, steps + 1, every)
    return positions_at(simulator, batch, at, steps=steps, recompute=recompute, skips=skips)


def positions_at(
    simulator: Simulator,
    batch: SceneBatch,
    at: Sequence[int],
    *,
    steps: int | None = None,
    recompute: bool | None = None,
    skips: Skips | None = None,
) -> Float[Tensor, "frames 3 particles"]:
    """Positions [m] at some steps, 0 being the start, with derivatives as in differentiable_rollout.

    at     increasing numbers of steps
    steps  how many are run, None for as many as are needed
    """
    skips, steps = skips or Skips(), max(at[-1], 1) if steps is None else steps
    batch = batch._replace(state=simulator.started(batch.state))
    state, scenes = batch.state, batch.scenes
    free = [min(n, steps - 1) for n in _free_steps(simulator, batch, steps, skips)]
    if recompute is None and not records_steps(simulator, state, scenes):
        most = MOST_COMPILED_PARTICLE_STEPS if simulator.runs_compiled(state) else MOST_PARTICLE_STEPS
        recompute = _particle_steps(scenes, steps, free) > most
    step_of = partial(simulator.step_function, one_graph=True)
    run = ActiveScenes(step_of, batch, simulator.integrator.settings.time_step, free)

    wanted = set(at)
    positions = [state.position] if 0 in wanted else []
    for n in sorted(n for n in {*wanted, *run.joins, steps} if 0 < n <= steps):
        run.reached(n, _differentiable_steps(simulator, run, n - run.n, bool(recompute)))
        if n in wanted:
            positions.append(run.whole().position)
    return torch.stack(positions)


def _differentiable_steps(simulator: Simulator, run: ActiveScenes, count: int, recompute: bool) -> ParticleState:
    """The state of the running scenes `count` steps later."""
    state, (scenes, parameters) = run.state, run.group[2:]
    if not run.any_running:
        return state
    if records_steps(simulator, state, scenes):
        given = (*state, *parameters.values(), *simulator.trained_weights())
        if torch.is_grad_enabled() and any(tensor.requires_grad for tensor in given):
            return differentiable_steps(simulator, state, scenes, parameters, count)
        return advanced(simulator, state, scenes, parameters, count)[0]
    for n in range(run.n, run.n + count):
        if recompute and torch.is_grad_enabled():
            state = recomputed_step(simulator, state, scenes, parameters, n)
        else:
            state = run.step(state, n)
    return state


class _Report(NamedTuple):
    """Whom to tell: the names, the advice and the domain for a divergence, and what hears of progress."""

    scene_names: Sequence[str] | None
    advice: str
    progress: Progress | None
    limits: Domain


def _run(
    run: ActiveScenes,
    recording: Recording,
    watch: RestWatch | None,
    report: _Report,
    simulator: Simulator | None = None,
) -> Trajectory:
    """Runs from one look to the next: at frames, where scenes begin to run, and where they may have come to rest.

    simulator  what the steps are of, None for any other step function
    """
    plan = recording.plan
    frames, rests = set(plan.frames), set(watch.looks if watch else ())
    _require_physical(run, failing_particles(run.state, report.limits), 0, report)
    for n in sorted(n for n in {*frames, *rests, *run.joins, plan.steps} if n <= plan.steps):
        _advance(run, n, report, simulator)
        if n in frames:
            recording.put(n, run.whole())
        if watch and n in rests and run.any_running:
            run.leave(watch.resting(n, run.group.numbers, run.state, run.group.scenes))
    return recording.trajectory()


def _advance(run: ActiveScenes, n: int, report: _Report, simulator: Simulator | None) -> None:
    """Runs to step n with one look at the device at its end; the exact step is found again when it matters."""
    state, count = run.state, n - run.n
    graph = simulator is not None and run.any_running and count > 0
    if simulator is not None and graph and records_steps(simulator, state, run.group.scenes):
        state, failed = advanced(simulator, state, run.group.scenes, run.group.parameters, count)
        if report.progress:
            report.progress(count)
        _require_physical(run, failed, count, report)
    elif run.any_running and count:
        failed = torch.zeros_like(run.group.scenes.scene_index, dtype=torch.bool)
        for k in range(run.n, n):
            state = run.step(state, k)
            failed = failed | failing_particles(state, report.limits)
            if report.progress:
                report.progress(1)
        _require_physical(run, failed, count, report)
    elif report.progress and count:
        report.progress(count)
    run.reached(n, state)


def _require_physical(run: ActiveScenes, failed: ParticleMask, count: int, report: _Report) -> None:
    """Raises the error that names the first failing particle, found by running again from the last good state.

    failed  which particles failed in the `count` steps after it
    """
    if not bool(failed.any()):
        return
    state, n, scene_index = run.state, run.n, run.group.scenes.scene_index
    while not bool((failing := failing_particles(state, report.limits)).any()) and n < run.n + count:
        state, n = run.step(state, n), n + 1
    again = bool(failing.any())
    count_guard("particles_that_failed", int((failing if again else failed).sum()))
    count_guard("scenes_that_diverged")
    particle = int((failing if again else failed).nonzero()[0])
    # on a GPU two runs differ by rounding
    why = (
        why_failing(state, particle, report.limits)
        if again
        else "it left the domain or turned inside out by no more than rounding"
    )
    scene = int(scene_index[particle])
    within = particle - int((scene_index < scene).sum())
    number = run.group.numbers[scene]
    name = report.scene_names[number] if report.scene_names else str(number)
    ending = f"; {report.advice}" if report.advice else ""
    kind = ParticleEscaped if again and left_domain(state, particle, report.limits) else SimulationDiverged
    raise kind(f"scene '{name}' diverged at step {n}: particle {within}: {why}{ending}")


def _free_steps(simulator: Simulator, batch: SceneBatch, steps: int, skips: Skips) -> list[int]:
    if not skips.free_fall:
        return [0] * batch.scenes.scene_count
    return free_steps(simulator, batch.state, batch.scenes, batch.parameters, steps)


def _particle_steps(scenes: Scenes, steps: int, free: Sequence[int]) -> int:
    """Steps of single particles that a rollout takes."""
    counts = torch.bincount(scenes.scene_index, minlength=scenes.scene_count).tolist()
    return sum(count * (steps - n) for count, n in zip(counts, free, strict=True))
