"""The MLS-MPM step of pcnclaws/mpm/integrator.py as one kernel, differentiable in both modes.

On a GPU it is several, differentiable in reverse mode alone.
"""

import ctypes
from dataclasses import dataclass
from functools import lru_cache
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
    origin     place of node 0 [m]
    per_metre  cells in a metre
    grid       first node along each axis, then the last one
    contact    of walls, as in WALL_CONTACTS of pcnclaws/mpm/integrator.py
    window     whether only the part of the grid that particles touch is computed
    walls      of the nodes of each axis: 1 for a wall at the low side, 2 at the high side, 0 for none; empty without
    order      of the affine XPIC of the transfer, 1 for APIC
    """

    time_step: float
    origin: tuple[float, float, float]
    per_metre: float
    grid: tuple[int, int, int, int, int, int]
    contact: int
    window: bool
    walls: bytes
    order: int

    @property
    def edges(self) -> tuple[int, int, int]:
        """Nodes along each axis."""
        x, y, z = (self.grid[3 + axis] - self.grid[axis] + 1 for axis in range(3))
        return x, y, z

    @property
    def size(self) -> int:
        """Nodes of a scene."""
        x, y, z = self.edges
        return x * y * z

    def described(self, walls: int | None, window: bool) -> Settings:
        """As the kernels read it. walls: the address of the walls."""
        grid, origin = (ctypes.c_int * 6)(*self.grid), (ctypes.c_double * 3)(*self.origin)
        return Settings(self.time_step, origin, self.per_metre, grid, self.contact, window, walls, self.order)


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


@lru_cache(maxsize=256)
def _settings(settings: StepSettings) -> tuple[Settings, object]:
    """What the kernels read, and what must stay alive with it."""
    walls = ctypes.create_string_buffer(settings.walls, len(settings.walls)) if settings.walls else None
    return settings.described(ctypes.addressof(walls) if walls else None, settings.window), walls


def call_step(name: str, settings: StepSettings, bodies: tuple[Tensor, ...], *fields: tuple[Tensor, ...]) -> None:
    """Runs a kernel of the step on a CPU, on groups of arrays."""
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
        return gpu.step_forward(gpu.StepInput(settings, bodies, state))
    after = tuple(torch.empty_like(field) for field in state[:4])
    call_step("step_forward", settings, bodies, state, after)
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
            gradient = gpu.step_adjoint(gpu.StepInput(ctx.settings, bodies, state), *given)
            return (None, None, None, None, None, None, *gradient)
        gradient = tuple(torch.empty_like(field) for field in state)
        after = (velocity, velocity, affine)  # the kernel reads the second and the third
        call_step("step_adjoint", ctx.settings, bodies, state, after, incoming, gradient)
        return (None, None, None, None, None, None, *gradient)

    @staticmethod
    def jvp(ctx: Any, *rates: Tensor | None) -> tuple[Tensor, ...]:  # pyright: ignore[reportIncompatibleMethodOverride]
        saved = ctx.saved_tensors
        bodies, state = saved[:4], saved[4:9]
        given = zip(state, rates[6:], strict=True)
        before = tuple(torch.zeros_like(field) if rate is None else rate.contiguous() for field, rate in given)
        after_rates = tuple(torch.empty_like(field) for field in state[:4])
        call_step("step_rates", ctx.settings, bodies, state, before, ctx.after, after_rates)
        return after_rates
