"""Steps on a GPU, fused by PyTorch's compiler and recorded as CUDA graphs.

The step of a small scene is some two hundred operations that take microseconds each: launched one by one from Python
they take several times longer than the GPU needs for them. The mathematics is that of Simulator, unchanged.
"""

import copy
import importlib.util
import logging
from collections import OrderedDict
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any
from weakref import WeakKeyDictionary

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from pcnclaws.backend import configured_backend
from pcnclaws.compiled.build import find_compiler
from pcnclaws.compiled.kernels import in_forward_mode, in_function_transform
from pcnclaws.mpm.diagnostics import failing_particles
from pcnclaws.mpm.state import ParticleState, Scenes
from pcnclaws.simulator import SCENE_FIELDS, STATE_FIELDS, Simulator, batch_from
from pcnclaws.tensor_types import Parameters, ParticleMask

log = logging.getLogger(__name__)

# Recordings kept for each simulator: one holds the memory of a step.
MOST_RECORDINGS = 8
# PyTorch compiles again for another material or setting, and refuses after a few times by default.
MOST_COMPILATIONS = 256
WARM_UP = 2  # steps before the recording, in which PyTorch compiles and libraries take their memory

StepFunction = Callable[[Simulator, ParticleState, Scenes, dict[str, Tensor]], tuple[Tensor, ...]]


def records_steps(state: ParticleState, scenes: Scenes) -> bool:
    """Whether steps of this state are recorded: on a GPU, unless simulation.backend=torch or in forward mode."""
    if not state.position.is_cuda or configured_backend() == "torch":
        return False
    if in_function_transform() or in_forward_mode():
        return False
    return not any(field.requires_grad for field in scenes[1:])


@torch.no_grad()
def advanced(
    simulator: Simulator, state: ParticleState, scenes: Scenes, parameters: Parameters, count: int
) -> tuple[ParticleState, ParticleMask]:
    """The state `count` steps later without a graph, and which particles failed on the way."""
    graphs = _graphs_for(simulator, state, scenes, parameters, ())
    return graphs.advance(state, count)


def differentiable_steps(
    simulator: Simulator, state: ParticleState, scenes: Scenes, parameters: Parameters, count: int
) -> ParticleState:
    """The state `count` steps later. The backward pass keeps the states alone and computes the steps again.

    Gradients reach the state, the parameters and the weights of the laws.
    """
    names, weights = tuple(parameters), simulator.trained_weights()
    fields = (*state, *scenes, *(parameters[name] for name in names))
    return ParticleState(*_Steps.apply(simulator, names, count, *fields, *weights))


class _Steps(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, simulator: Simulator, names: tuple[str, ...], count: int, *tensors: Tensor
    ) -> tuple[Tensor, ...]:
        state, scenes, parameters = batch_from(tensors, names)
        needed = ctx.needs_input_grad[3 + STATE_FIELDS + SCENE_FIELDS :]
        graphs = _graphs_for(simulator, state, scenes, parameters, needed)
        ctx.simulator, ctx.names, ctx.needed = simulator, names, needed
        ctx.save_for_backward(*tensors[: STATE_FIELDS + SCENE_FIELDS + len(names)], graphs.history(state, count))
        return tuple(graphs.result())

    @staticmethod
    @once_differentiable
    def backward(  # pyright: ignore[reportIncompatibleMethodOverride]  # the decorator is untyped
        ctx: Any, *gradients: Tensor
    ) -> tuple[Tensor | None, ...]:
        *tensors, history = ctx.saved_tensors
        graphs = _graphs_for(ctx.simulator, *batch_from(tensors, ctx.names), ctx.needed)
        of_state, of_others = graphs.pull_back(history, gradients)
        found = iter(of_others)
        return (
            *(None, None, None),
            *of_state,
            *(None for _ in range(SCENE_FIELDS)),
            *(next(found) if need else None for need in ctx.needed),
        )


class _Packed:
    """A copy of some tensors in one piece of memory, which is copied and added to by one operation."""

    def __init__(self, tensors: Sequence[Tensor]) -> None:
        flat = [tensor.detach().reshape(-1) for tensor in tensors]
        self.memory = torch.cat(flat) if flat else torch.empty(0)
        pieces = self.memory.split([len(piece) for piece in flat])
        self.parts = [piece.view(tensor.shape) for piece, tensor in zip(pieces, tensors, strict=True)]


class _StepGraphs:
    """The step of batches of one shape, recorded.

    needed  which of the parameters and then of the weights are differentiated; none of them: forward steps alone
    """

    def __init__(
        self,
        simulator: Simulator,
        state: ParticleState,
        scenes: Scenes,
        parameters: Parameters,
        needed: Sequence[bool],
    ) -> None:
        self._simulator = _twin(simulator)
        # what the recorded operations read and write: their addresses are part of the recording
        self._state = _Packed(state)
        self._scenes = Scenes(*(field.clone() for field in scenes))
        self._parameters = {name: values.detach().clone() for name, values in parameters.items()}
        self._failed = torch.zeros_like(scenes.scene_index, dtype=torch.bool)
        self._step = _step_function()
        self._forward = _recorded(self._step_forward)
        self._backward: torch.cuda.CUDAGraph | None = None
        if needed:
            weights = self._simulator.trained_weights()
            others = [*self._parameters.values(), *weights]
            self._gradient, self._needed = _Packed(state), needed
            self._sums = _Packed([tensor for tensor, need in zip(others, needed, strict=True) if need])
            self._load(state)
            self._backward = _recorded(self._step_backward)

    def take(self, scenes: Scenes, parameters: Parameters) -> None:
        """The batch that the next steps are of."""
        _copy([*self._scenes, *self._parameters.values()], [*scenes, *parameters.values()])

    def advance(self, state: ParticleState, count: int) -> tuple[ParticleState, ParticleMask]:
        """The state `count` steps later, and which particles failed on the way."""
        self._load(state)
        for _ in range(count):
            self._forward.replay()
        return self.result(), self._failed.clone()

    def history(self, state: ParticleState, count: int) -> Tensor:
        """Runs `count` steps and keeps the state before each of them, (steps, numbers of a state)."""
        self._load(state)
        history = self._state.memory.new_empty(count, len(self._state.memory))
        for before in history:
            before.copy_(self._state.memory)
            self._forward.replay()
        return history

    def result(self) -> ParticleState:
        """The state that the last step has reached."""
        return ParticleState(*_Packed(self._state.parts).parts)

    def pull_back(self, history: Tensor, gradients: Sequence[Tensor]) -> tuple[ParticleState, list[Tensor]]:
        """Gradients of the state before the steps, and of what is needed of parameters and weights."""
        if self._backward is None:
            raise RuntimeError("recorded without a backward pass")
        _copy(self._gradient.parts, gradients)
        self._sums.memory.zero_()
        for before in history.flip(0):
            self._state.memory.copy_(before)
            self._backward.replay()
        return ParticleState(*_Packed(self._gradient.parts).parts), _Packed(self._sums.parts).parts

    def _load(self, state: ParticleState) -> None:
        _copy(self._state.parts, state)
        self._failed.zero_()

    @torch.no_grad()
    def _step_forward(self) -> None:
        state = ParticleState(*self._state.parts)
        after = ParticleState(*self._step(self._simulator, state, self._scenes, self._parameters))
        self._failed.logical_or_(failing_particles(after))
        _copy(self._state.parts, after)

    def _step_backward(self) -> None:
        fields = [field.detach().requires_grad_() for field in self._state.parts]
        parameters = {
            name: values.detach().requires_grad_(need)
            for (name, values), need in zip(self._parameters.items(), self._needed, strict=False)
        }
        others = [*parameters.values(), *self._simulator.trained_weights()]
        wanted = [*fields, *(tensor for tensor, need in zip(others, self._needed, strict=True) if need)]
        with torch.enable_grad():
            after = self._step(self._simulator, ParticleState(*fields), self._scenes, parameters)
        found = torch.autograd.grad(after, wanted, self._gradient.parts, allow_unused=True, materialize_grads=True)
        with torch.no_grad():
            _copy(self._gradient.parts, found[:STATE_FIELDS])
            if self._sums.parts:
                self._sums.memory.add_(torch.cat([gradient.reshape(-1) for gradient in found[STATE_FIELDS:]]))


def _twin(simulator: Simulator) -> Simulator:
    """The same simulator with the same memory of weights, which no graph of the user's holds on to.

    Else a recording would wait for the stream that such a graph was made on, which CUDA does not allow.
    """
    twin = copy.deepcopy(simulator)
    for ours, theirs in zip(twin.parameters(), simulator.parameters(), strict=True):
        ours.data = theirs.data
    return twin


_kept: WeakKeyDictionary[Simulator, OrderedDict[Any, _StepGraphs]] = WeakKeyDictionary()


def _graphs_for(
    simulator: Simulator, state: ParticleState, scenes: Scenes, parameters: Parameters, needed: Sequence[bool]
) -> _StepGraphs:
    """A recording for this batch, made now or kept from one of the same shape."""
    recordings = _kept.setdefault(simulator, OrderedDict())
    addresses = tuple(tensor.data_ptr() for tensor in (*simulator.parameters(), *simulator.buffers()))
    shape = state.position.shape[1], scenes.scene_count, state.position.dtype, state.position.device
    key = (shape, tuple(parameters), tuple(needed), addresses)
    if key in recordings:
        recordings.move_to_end(key)
        recordings[key].take(scenes, parameters)
    else:
        recordings[key] = _StepGraphs(simulator, state, scenes, parameters, needed)
        if len(recordings) > MOST_RECORDINGS:
            recordings.popitem(last=False)
    return recordings[key]


@cache
def _step_function() -> StepFunction:
    """Simulator.forward, its operations fused into few where PyTorch's compiler can work."""
    if importlib.util.find_spec("triton") is None or find_compiler() is None:
        log.warning("Triton or a C++ compiler is missing: the operations of a step are not fused, which is slower")
        return _step
    log.warning(
        "compiling the step for this GPU: once for each law, which takes a while, less in later runs "
        "(simulation.backend=torch goes without)"
    )
    dynamo = torch._dynamo.config
    dynamo.recompile_limit = max(dynamo.recompile_limit, MOST_COMPILATIONS)
    dynamo.accumulated_recompile_limit = max(dynamo.accumulated_recompile_limit, MOST_COMPILATIONS)
    # one compilation serves every number of particles
    return torch.compile(_step, dynamic=True, fullgraph=True)


def _step(
    simulator: Simulator, state: ParticleState, scenes: Scenes, parameters: dict[str, Tensor]
) -> tuple[Tensor, ...]:
    return tuple(simulator(state, scenes, parameters))


def _recorded(work: Callable[[], None]) -> torch.cuda.CUDAGraph:
    """The operations of some work as a graph to replay."""
    aside = torch.cuda.Stream()
    aside.wait_stream(torch.cuda.current_stream())
    with torch.cuda.stream(aside):
        for _ in range(WARM_UP):
            work()
    torch.cuda.current_stream().wait_stream(aside)
    graph = torch.cuda.CUDAGraph()
    with torch.cuda.graph(graph):
        work()
    return graph


@torch.no_grad()
def _copy(into: Sequence[Tensor], values: Sequence[Tensor]) -> None:
    for target, source in zip(into, values, strict=True):
        target.copy_(source)
