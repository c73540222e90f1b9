"""Gradient checkpointing of a step: it keeps its inputs instead of its graph."""

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from pcnclaws.mpm.state import ParticleState, Scenes
from pcnclaws.simulation.simulator import SCENE_FIELDS, STATE_FIELDS, Simulator
from pcnclaws.tensors.tensor_types import Parameters


def recomputed_step(
    simulator: Simulator, state: ParticleState, scenes: Scenes, parameters: Parameters, n: int = 0
) -> ParticleState:
    """One step whose backward pass computes the step again.

    Gradients reach the state, the scenes, the parameters, the weights of the laws and the numbers of colliders. The
    general checkpoint of PyTorch keeps a record of every operation of every step; this keeps the state alone.
    n  number of steps since the start
    """
    names = tuple(parameters)
    fields = (*state, *scenes, *(parameters[name] for name in names))
    return ParticleState(*_RecomputedStep.apply(simulator, names, n, *fields, *simulator.differentiated()))


class _RecomputedStep(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, simulator: Simulator, names: tuple[str, ...], n: int, *tensors: Tensor) -> tuple[Tensor, ...]:
        ctx.simulator, ctx.names, ctx.n = simulator, names, n
        # the weights, too: PyTorch then finds out when they have changed before the backward pass
        ctx.save_for_backward(*tensors)
        return tuple(_step(simulator, names, tensors, n, evaluated=True))

    @staticmethod
    @once_differentiable
    def backward(  # pyright: ignore[reportIncompatibleMethodOverride]  # the decorator is untyped
        ctx: Any, *gradients: Tensor
    ) -> tuple[Tensor | None, ...]:
        needed = ctx.needs_input_grad[3:]
        saved = ctx.saved_tensors[: STATE_FIELDS + SCENE_FIELDS + len(ctx.names)]
        fields = [tensor.detach().requires_grad_(need) for tensor, need in zip(saved, needed, strict=False)]
        tensors = [*fields, *ctx.simulator.differentiated()]
        with torch.enable_grad():
            after = _step(ctx.simulator, ctx.names, fields, ctx.n, evaluated=False)
        wanted = [tensor for tensor, need in zip(tensors, needed, strict=True) if need]
        # internal variables that nothing changes may carry no derivative
        carried = [(field, gradient) for field, gradient in zip(after, gradients, strict=True) if field.requires_grad]
        outputs, incoming = zip(*carried, strict=True)
        found = iter(torch.autograd.grad(outputs, wanted, incoming, allow_unused=True))
        return (None, None, None, *(next(found) if need else None for need in needed))


def _step(
    simulator: Simulator, names: tuple[str, ...], tensors: Sequence[Tensor], n: int, evaluated: bool
) -> ParticleState:
    state, others = tensors[:STATE_FIELDS], tensors[STATE_FIELDS:]
    parameters = dict(zip(names, others[SCENE_FIELDS:], strict=False))
    return simulator(ParticleState(*state), Scenes(*others[:SCENE_FIELDS]), parameters, evaluated, n)
