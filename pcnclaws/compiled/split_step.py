"""The MLS-MPM step in two kernels, with the grid between them: for boundaries that are computed in PyTorch.

Both are differentiable in both modes, on a GPU in reverse mode alone. All scenes have the whole grid of the settings,
which should be the part that particles touch.
"""

from dataclasses import replace
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from pcnclaws.compiled import gpu
from pcnclaws.compiled.calls import carries_rates, require_first_derivative
from pcnclaws.compiled.step import MoreTensors, StepSettings, call_step

Tensors = tuple[Tensor, ...]
ALIGNMENT = 32  # bytes


def to_grid(settings: StepSettings, bodies: Tensors, state: Tensors) -> Float[Tensor, "nodes 4"]:
    """Momentum [kg m/s] and mass [kg] of the nodes of all scenes; bodies and state as in step.step."""
    particles = state[0].shape[-1]
    scene, mass, volume, gravity = bodies
    bodies = (scene.long(), mass.expand(particles), volume.expand(particles), gravity)
    return _ToGrid.apply(settings, carries_rates(state), *bodies, *state)


def from_grid(
    settings: StepSettings, bodies: Tensors, velocity: Float[Tensor, "3 nodes"], position: Tensor, deformation: Tensor
) -> Tensors:
    """Position, velocity, affine and trial deformation after the step, from the velocities of the nodes [m/s]."""
    particles = position.shape[-1]
    scene, mass, volume, gravity = bodies
    bodies = (scene.long(), mass.expand(particles), volume.expand(particles), gravity)
    quads = torch.cat((velocity, torch.zeros_like(velocity[:1]))).T
    later = carries_rates((quads, position, deformation))
    return _FromGrid.apply(settings, later, *bodies, quads, position, deformation)


class _ToGrid(torch.autograd.Function):
    """later: as in step._Step."""

    @staticmethod
    def forward(ctx: Any, settings: StepSettings, later: bool, *tensors: Tensor) -> Tensor:
        bodies, state = _contiguous(tensors[:4]), _contiguous(tensors[4:])
        nodes = state[0].new_zeros(settings.size * bodies[3].shape[1], 4)
        ctx.settings, ctx.nodes = settings, nodes.detach() if later else None
        ctx.save_for_backward(*bodies, *state)
        ctx.save_for_forward(*bodies, *state)
        if later:
            return nodes
        if nodes.is_cuda:
            gpu.step_to_grid(gpu.StepInput(settings, bodies, state), nodes)
        else:
            call_step("to_grid", settings, bodies, state, (nodes,))
        return nodes

    @staticmethod
    def backward(ctx: Any, *incoming: Tensor) -> MoreTensors:  # pyright: ignore[reportIncompatibleMethodOverride]
        require_first_derivative()
        bodies, state = ctx.saved_tensors[:4], ctx.saved_tensors[4:]
        (gradients,) = _contiguous(incoming)
        still = tuple(torch.zeros_like(field) for field in state[:4])
        gradient = _gathered(ctx.settings, bodies, state, torch.zeros_like(gradients), gradients, still, still)
        return (None,) * 6 + (*gradient[:3], None, gradient[4])

    @staticmethod
    def jvp(ctx: Any, *rates: Tensor | None) -> Tensor:  # pyright: ignore[reportIncompatibleMethodOverride]
        bodies, state = ctx.saved_tensors[:4], ctx.saved_tensors[4:]
        both = state[0].new_zeros(len(ctx.nodes), 2, 4)
        call_step("to_grid_rates", ctx.settings, bodies, state, _rates(state, rates[6:]), (both,))
        ctx.nodes.copy_(both[:, 0])
        return both[:, 1].clone()


class _FromGrid(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, settings: StepSettings, later: bool, *tensors: Tensor) -> Tensors:
        bodies, (nodes, position, deformation) = _contiguous(tensors[:4]), _contiguous(tensors[4:])
        after = tuple(map(torch.empty_like, (position, position, deformation, deformation)))
        before = (position, position, deformation, deformation)  # the second and the third are not read
        if not later:
            if nodes.is_cuda:
                gpu.step_from_grid(gpu.StepInput(settings, bodies, before), nodes, after)
            else:
                call_step("from_grid", settings, bodies, before, (nodes,), after)
        ctx.settings, ctx.after = settings, tuple(field.detach() for field in after) if later else ()
        ctx.save_for_backward(*bodies, nodes, position, deformation, after[1], after[2])
        ctx.save_for_forward(*bodies, nodes, position, deformation)
        return after

    @staticmethod
    def backward(ctx: Any, *incoming: Tensor) -> MoreTensors:  # pyright: ignore[reportIncompatibleMethodOverride]
        require_first_derivative()
        *saved, velocity, affine = ctx.saved_tensors
        bodies, (nodes, position, deformation) = tuple(saved[:4]), saved[4:]
        incoming = _contiguous(incoming)
        none = torch.zeros_like(deformation)
        state = (position, torch.zeros_like(position), none, deformation, none)
        of_nodes = torch.zeros_like(nodes)
        if nodes.is_cuda:
            gpu.step_to_node_velocities(gpu.StepInput(ctx.settings, bodies, state), incoming, of_nodes)
        else:
            call_step("to_node_velocities", ctx.settings, bodies, state, incoming, (of_nodes,))
        after = (velocity, velocity, affine)  # the second and the third are read
        back = replace(ctx.settings, order=1)  # the way back is that of APIC
        gradient = _gathered(back, bodies, state, nodes, torch.zeros_like(nodes), after, incoming)
        return (None,) * 6 + (of_nodes, gradient[0], gradient[3])

    @staticmethod
    def jvp(ctx: Any, *rates: Tensor | None) -> Tensors:  # pyright: ignore[reportIncompatibleMethodOverride]
        bodies, (nodes, position, deformation) = ctx.saved_tensors[:4], ctx.saved_tensors[4:]
        of_nodes, of_position, of_deformation = _rates((nodes, position, deformation), rates[6:])
        both = torch.stack((nodes, of_nodes), dim=1).contiguous()
        before = (position, position, deformation, deformation)
        before_rates = (of_position, of_position, of_deformation, of_deformation)
        after_rates = tuple(torch.empty_like(field) for field in ctx.after)
        call_step("from_grid_rates", ctx.settings, bodies, before, before_rates, (both,), ctx.after, after_rates)
        return after_rates


def _gathered(
    settings: StepSettings,
    bodies: Tensors,
    state: Tensors,
    velocities: Tensor,
    gradients: Tensor,
    after: Tensors,
    incoming: Tensors,
) -> Tensors:
    """Gradients of the five fields of the state from velocities of the nodes and gradients at momentum and mass."""
    gradient = tuple(torch.empty_like(field) for field in state)
    if velocities.is_cuda:
        nodes = gpu.Nodes(gradients, velocities)
        gpu.step_gather_gradient(gpu.StepInput(settings, bodies, state), nodes, after, incoming, gradient)
    else:
        call_step("gather_gradient", settings, bodies, state, (velocities, gradients), after, incoming, gradient)
    return gradient


def _contiguous(tensors: Tensors) -> Tensors:
    """The tensors as the kernels read them; nodes begin at addresses of four numbers."""
    whole = (tensor.contiguous() for tensor in tensors)
    return tuple(tensor if tensor.data_ptr() % ALIGNMENT == 0 else tensor.clone() for tensor in whole)


def _rates(fields: Tensors, rates: tuple[Tensor | None, ...]) -> Tensors:
    """The tangents of some fields, zeros where there are none."""
    pairs = zip(fields, rates, strict=True)
    return tuple(torch.zeros_like(field) if rate is None else rate.contiguous() for field, rate in pairs)
