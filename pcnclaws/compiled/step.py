"""The MLS-MPM step of pcnclaws/mpm/integrator.py as one kernel, differentiable in both modes.

On a GPU it is several, differentiable in reverse mode alone.
"""

import ctypes
from dataclasses import dataclass
from functools import cache
from typing import Any

import torch
from torch import Tensor

from pcnclaws.compiled import gpu
from pcnclaws.compiled.build import kernel_library
from pcnclaws.compiled.calls import addresses, call, carries_rates, derivatives_wanted, require_first_derivative
from pcnclaws.compiled.structures import Bodies, Settings

MoreTensors = tuple[Tensor | None, ...]


@dataclass(frozen=True)
class StepSettings:
    """What the kernel needs to know beside the particles.

    time_step  [s]
    nodes      cells along an edge of the domain
    stick      whether walls hold the whole velocity
    window     whether only the part of the grid that particles touch is computed
    walls      of the nodes -1 to nodes + 1 of an axis: 1 for a wall at the low side, 2 at the high side, 0 for none
    """

    time_step: float
    nodes: int
    stick: bool
    window: bool
    walls: bytes


def step(settings: StepSettings, bodies: tuple[Tensor, ...], state: tuple[Tensor, ...]) -> tuple[Tensor, ...]:
    """Position, velocity, affine and trial deformation one time step later.

    bodies  scene_index (particles,) in increasing order, mass and volume (particles,), gravity (3, scenes)
    state   position, velocity (3, particles), affine, deformation and Kirchhoff stress (3, 3, particles)
    """
    scene, mass, volume, gravity = bodies
    particles = state[0].shape[-1]
    if any(field.shape[-1] != particles for field in (scene, *state)):
        raise ValueError("the fields of a state and scene_index need the same number of particles")
    bodies = (scene.long(), mass.expand(particles), volume.expand(particles), gravity)
    if not derivatives_wanted():
        return _stepped(settings, _contiguous(bodies), _contiguous(state))[0]
    return _Step.apply(settings, carries_rates(state), *bodies, *state)


@cache
def _settings(settings: StepSettings) -> tuple[Settings, object]:
    """What the kernels read, and what must stay alive with it."""
    walls = ctypes.create_string_buffer(settings.walls, len(settings.walls))
    numbers = settings.time_step, settings.nodes, settings.stick, settings.window
    return Settings(*numbers, ctypes.addressof(walls)), walls


def _on_gpu(settings: StepSettings, bodies: tuple[Tensor, ...], state: tuple[Tensor, ...]) -> gpu.StepInput:
    return gpu.StepInput(settings.time_step, settings.nodes, settings.stick, settings.walls, bodies, state)


def _call(name: str, settings: StepSettings, bodies: tuple[Tensor, ...], *fields: tuple[Tensor, ...]) -> None:
    scene, mass, volume, gravity = bodies
    arrays = [tensor.data_ptr() for tensor in (scene, mass, volume, gravity)]
    described = Bodies(mass.numel(), gravity.shape[1], *arrays)
    pointers = [addresses(*group) for group in fields]
    call(kernel_library(), name, mass.dtype, ctypes.byref(_settings(settings)[0]), ctypes.byref(described), *pointers)


def _stepped(
    settings: StepSettings, bodies: tuple[Tensor, ...], state: tuple[Tensor, ...]
) -> tuple[tuple[Tensor, ...], gpu.Nodes | None]:
    """The state after, and on a GPU the nodes on the way, for the backward pass."""
    if state[0].is_cuda:
        return gpu.step_forward(_on_gpu(settings, bodies, state))
    after = tuple(torch.empty_like(field) for field in state[:4])
    _call("step_forward", settings, bodies, state, after)
    return after, None


def _contiguous(tensors: tuple[Tensor, ...]) -> tuple[Tensor, ...]:
    return tuple(tensor.contiguous() for tensor in tensors)


class _Step(torch.autograd.Function):
    """later: the kernel of the rates computes the state, too, and jvp, which PyTorch calls next, fills it in."""

    @staticmethod
    def forward(ctx: Any, settings: StepSettings, later: bool, *tensors: Tensor) -> tuple[Tensor, ...]:
        bodies, state = _contiguous(tensors[:4]), _contiguous(tensors[4:])
        nodes = None
        if later:
            after = tuple(torch.empty_like(field) for field in state[:4])
        else:
            after, nodes = _stepped(settings, bodies, state)
        ctx.settings, ctx.after = settings, tuple(field.detach() for field in after) if later else ()
        ctx.save_for_backward(*bodies, *state, after[1], after[2], *(nodes or ()))
        ctx.save_for_forward(*bodies, *state)
        return after

    @staticmethod
    def backward(  # pyright: ignore[reportIncompatibleMethodOverride]
        ctx: Any, *incoming: Tensor
    ) -> MoreTensors:
        require_first_derivative()
        saved = ctx.saved_tensors
        bodies, state, (velocity, affine, *nodes) = saved[:4], saved[4:9], saved[9:]
        incoming = _contiguous(incoming)
        if state[0].is_cuda:
            given = gpu.Nodes(*nodes), velocity, affine, incoming
            gradient = gpu.step_adjoint(_on_gpu(ctx.settings, bodies, state), *given)
            return (None, None, None, None, None, None, *gradient)
        gradient = tuple(torch.empty_like(field) for field in state)
        after = (velocity, velocity, affine)  # the kernel reads the second and the third
        _call("step_adjoint", ctx.settings, bodies, state, after, incoming, gradient)
        return (None, None, None, None, None, None, *gradient)

    @staticmethod
    def jvp(ctx: Any, *rates: Tensor | None) -> tuple[Tensor, ...]:  # pyright: ignore[reportIncompatibleMethodOverride]
        saved = ctx.saved_tensors
        bodies, state = saved[:4], saved[4:9]
        given = zip(state, rates[6:], strict=True)
        before = tuple(torch.zeros_like(field) if rate is None else rate.contiguous() for field, rate in given)
        after_rates = tuple(torch.empty_like(field) for field in state[:4])
        _call("step_rates", ctx.settings, bodies, state, before, ctx.after, after_rates)
        return after_rates
