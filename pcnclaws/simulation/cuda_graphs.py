"""CUDA graphs of steps on a GPU.

A step of the kernels is some ten operations, one of PyTorch some two hundred, that take microseconds each: launched one
by one from Python they take several times longer than the GPU needs for them. The mathematics is that of Simulator,
unchanged.
"""

import copy
from collections import OrderedDict
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from pcnclaws.compiled.backend import configured_backend
from pcnclaws.compiled.calls import in_forward_mode, in_function_transform, kernels_serve
from pcnclaws.laws.fixed_parameters import FixedParameters
from pcnclaws.mpm.state import ParticleState, Scenes
from pcnclaws.simulation.physical_states import failing_particles
from pcnclaws.simulation.simulator import SCENE_FIELDS, STATE_FIELDS, Simulator
from pcnclaws.tensors.tensor_types import Parameters, ParticleMask

# Recordings kept for each simulator: one holds the memory of a step.
MOST_RECORDINGS = 8
WARM_UP = 2  # steps before the recording, in which kernels are compiled and libraries take their memory


def records_steps(simulator: Simulator, state: ParticleState, scenes: Scenes) -> bool:
    """Whether steps of this state are recorded: on a GPU, unless simulation.backend=torch or in forward mode.

    Where PyTorch's deterministic algorithms are asked for, none are: kernels add up in an order of their own. Those
    with colliders or loads, which change with time, are not, nor those in large or unbounded domains.
    """
    if not state.position.is_cuda or configured_backend() == "torch" or not simulator.integrator.is_recordable:
        return False
    if in_function_transform() or in_forward_mode() or torch.are_deterministic_algorithms_enabled():
        return False
    return not any(field.requires_grad for field in scenes.constants)


@torch.no_grad()
def advanced(
    simulator: Simulator, state: ParticleState, scenes: Scenes, parameters: Parameters, count: int
) -> tuple[ParticleState, ParticleMask]:
    """The state `count` steps later without a graph, and which particles failed on the way."""
    batch = _Batch(state, scenes, *_law_inputs(simulator, state, scenes, parameters))
    return _graphs_for(simulator, batch, None).advance(state, count)


def differentiable_steps(
    simulator: Simulator, state: ParticleState, scenes: Scenes, parameters: Parameters, count: int
) -> ParticleState:
    """The state `count` steps later. The backward pass keeps the states alone and computes the steps again.

    Gradients reach the state, the parameters and the weights of the laws.
    """
    names, inputs = _law_inputs(simulator, state, scenes, parameters)
    tensors = (*state, *scenes, *inputs, *simulator.trained_weights())
    return ParticleState(*_Steps.apply(simulator, names, len(inputs), count, *tensors))


class _Batch(NamedTuple):
    """What steps are computed of.

    names   of the parameters that the laws take, None where they have kernels
    inputs  those parameters; or of each law the rows that its kernel reads
    """

    state: ParticleState
    scenes: Scenes
    names: tuple[str, ...] | None
    inputs: Sequence[Tensor]


def _law_inputs(
    simulator: Simulator, state: ParticleState, scenes: Scenes, parameters: Parameters
) -> tuple[tuple[str, ...] | None, list[Tensor]]:
    """Names and inputs of _Batch: what kernels read of the parameters is computed and differentiated once."""
    parameters = simulator.law_parameters(parameters)
    given = (*state[1:], *parameters.values())
    served = kernels_serve(state.position, given, scenes.constants, list(simulator.parameters()))
    if not (served and simulator.runs_compiled(state)):
        return tuple(parameters), list(parameters.values())
    particles = state.position.shape[1]
    return None, [law.kernel_rows(parameters).expand(-1, particles).contiguous() for law in simulator.laws]


def _parameters_of(simulator: Simulator, names: tuple[str, ...] | None, inputs: Sequence[Tensor]) -> Parameters:
    if names is None:
        return FixedParameters.of_rows(dict(zip(simulator.laws, inputs, strict=True)))
    return dict(zip(names, inputs, strict=True))


class _Steps(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, simulator: Simulator, names: tuple[str, ...] | None, inputs: int, count: int, *tensors: Tensor
    ) -> tuple[Tensor, ...]:
        ctx.needed = ctx.needs_input_grad[4 + STATE_FIELDS + SCENE_FIELDS :]
        ctx.simulator, ctx.names, ctx.fields = simulator, names, STATE_FIELDS + SCENE_FIELDS + inputs
        batch = _batch_from(names, tensors[: ctx.fields])
        graphs = _graphs_for(simulator, batch, ctx.needed)
        # the weights, too: PyTorch then finds out when they have changed before the backward pass
        ctx.save_for_backward(graphs.history(batch.state, count), *tensors)
        return tuple(graphs.result())

    @staticmethod
    @once_differentiable
    def backward(  # pyright: ignore[reportIncompatibleMethodOverride]  # the decorator is untyped
        ctx: Any, *gradients: Tensor
    ) -> tuple[Tensor | None, ...]:
        history, *tensors = ctx.saved_tensors
        graphs = _graphs_for(ctx.simulator, _batch_from(ctx.names, tensors[: ctx.fields]), ctx.needed)
        of_state, of_others = graphs.pull_back(history, gradients)
        found = iter(of_others)
        return (
            *(None, None, None, None),
            *of_state,
            *(None for _ in range(SCENE_FIELDS)),
            *(next(found) if need else None for need in ctx.needed),
        )


def _batch_from(names: tuple[str, ...] | None, tensors: Sequence[Tensor]) -> _Batch:
    state, others = tensors[:STATE_FIELDS], tensors[STATE_FIELDS:]
    return _Batch(ParticleState(*state), Scenes(*others[:SCENE_FIELDS]), names, others[SCENE_FIELDS:])


class _Packed:
    """A copy of some tensors in one piece of memory, which is copied and added to by one operation."""

    def __init__(self, tensors: Sequence[Tensor]) -> None:
        flat = [tensor.detach().reshape(-1) for tensor in tensors]
        self.memory = torch.cat(flat) if flat else torch.empty(0)
        pieces = self.memory.split([len(piece) for piece in flat])
        self.parts = [piece.view(tensor.shape) for piece, tensor in zip(pieces, tensors, strict=True)]


class _StepGraphs:
    """The step of batches of one shape, recorded.

    needed  which of the parameters and then of the weights are differentiated; None: forward steps alone
    raises  ValueError for a scene_index that is none
    """

    def __init__(self, simulator: Simulator, batch: _Batch, needed: Sequence[bool] | None) -> None:
        _check_scenes(batch.scenes)
        self._simulator, self._names = _twin(simulator), batch.names
        self._laws = simulator.laws  # alive, so that no other law gets their place in memory and in _graphs_for
        self._device = batch.state.position.device
        # what the recorded operations read and write: their addresses are part of the recording
        self._state = _Packed(batch.state)
        self._scenes = Scenes(*(field.clone() for field in batch.scenes))
        self._inputs = [values.detach().clone() for values in batch.inputs]
        self._failed = torch.zeros_like(batch.scenes.scene_index, dtype=torch.bool)
        self._forward = _recorded(self._step_forward, self._device)
        self._backward: torch.cuda.CUDAGraph | None = None
        if needed is not None:
            others = [*self._inputs, *self._simulator.trained_weights()]
            self._gradient, self._needed = _Packed(batch.state), needed
            self._sums = _Packed([tensor for tensor, need in zip(others, needed, strict=True) if need])
            self._load(batch.state)
            self._backward = _recorded(self._step_backward, self._device)

    def take(self, batch: _Batch) -> None:
        """The batch that the next steps are of."""
        _copy([*self._scenes, *self._inputs], [*batch.scenes, *batch.inputs])

    def advance(self, state: ParticleState, count: int) -> tuple[ParticleState, ParticleMask]:
        """The state `count` steps later, and which particles failed on the way."""
        self._load(state)
        with torch.cuda.device(self._device):
            for _ in range(count):
                self._forward.replay()
        return self.result(), self._failed.clone()

    def history(self, state: ParticleState, count: int) -> Tensor:
        """Runs `count` steps and keeps the state before each of them, (steps, numbers of a state)."""
        self._load(state)
        history = self._state.memory.new_empty(count, len(self._state.memory))
        with torch.cuda.device(self._device):
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
        with torch.cuda.device(self._device):
            for before in reversed(history.unbind()):
                self._state.memory.copy_(before)
                self._backward.replay()
        return ParticleState(*_Packed(self._gradient.parts).parts), _Packed(self._sums.parts).parts

    def _load(self, state: ParticleState) -> None:
        _copy(self._state.parts, state)
        self._failed.zero_()

    @torch.no_grad()
    def _step_forward(self) -> None:
        after = self._step(ParticleState(*self._state.parts), self._inputs)
        self._failed.logical_or_(failing_particles(after, self._simulator.integrator.settings.limits))
        _copy(self._state.parts, after)

    def _step(self, state: ParticleState, inputs: Sequence[Tensor], evaluated: bool = True) -> ParticleState:
        return self._simulator(state, self._scenes, _parameters_of(self._simulator, self._names, inputs), evaluated)

    def _step_backward(self) -> None:
        fields = [field.detach().requires_grad_() for field in self._state.parts]
        inputs = [
            values.detach().requires_grad_(need) for values, need in zip(self._inputs, self._needed, strict=False)
        ]
        others = [*inputs, *self._simulator.trained_weights()]
        wanted = [*fields, *(tensor for tensor, need in zip(others, self._needed, strict=True) if need)]
        with torch.enable_grad():
            after = self._step(ParticleState(*fields), inputs, evaluated=False)
        found = torch.autograd.grad(after, wanted, self._gradient.parts, allow_unused=True, materialize_grads=True)
        with torch.no_grad():
            _copy(self._gradient.parts, found[:STATE_FIELDS])
            if self._sums.parts:
                self._sums.memory.add_(torch.cat([gradient.reshape(-1) for gradient in found[STATE_FIELDS:]]))


def _twin(simulator: Simulator) -> Simulator:
    """The same simulator with the same memory of weights and buffers, which no graph of the user's holds on to.

    Else a recording would wait for the stream that such a graph was made on, which CUDA does not allow.
    """
    twin = copy.deepcopy(simulator)
    for ours, theirs in zip(_memory_of(twin), _memory_of(simulator), strict=True):
        ours.data = theirs.data
    return twin


def _memory_of(simulator: Simulator) -> list[Tensor]:
    return [*simulator.parameters(), *simulator.buffers()]


def _check_scenes(scenes: Scenes) -> None:
    index = scenes.scene_index
    if index.numel() and not (int(index.min()) >= 0 and int(index.max()) < scenes.scene_count):
        raise ValueError(f"scene_index must hold numbers from 0 to below the number of scenes, {scenes.scene_count}")


_kept: WeakKeyDictionary[Simulator, OrderedDict[Any, _StepGraphs]] = WeakKeyDictionary()


def _graphs_for(simulator: Simulator, batch: _Batch, needed: Sequence[bool] | None) -> _StepGraphs:
    """A recording for this batch, made now or kept from one of the same shape."""
    recordings = _kept.setdefault(simulator, OrderedDict())
    key = (
        tuple((tensor.shape, tensor.dtype, tensor.device) for tensor in (*batch.state, *batch.scenes, *batch.inputs)),
        batch.names,
        None if needed is None else tuple(needed),
        tuple(id(law) for law in simulator.laws),
        simulator.integrator.settings,
        tuple((tensor.data_ptr(), tensor.requires_grad) for tensor in _memory_of(simulator)),
    )
    if key in recordings:
        recordings.move_to_end(key)
        recordings[key].take(batch)
    else:
        recordings[key] = _StepGraphs(simulator, batch, needed)
        if len(recordings) > MOST_RECORDINGS:
            recordings.popitem(last=False)
    return recordings[key]


def _recorded(work: Callable[[], None], device: torch.device) -> torch.cuda.CUDAGraph:
    """The operations of some work on a GPU as a graph to replay."""
    with torch.cuda.device(device):
        aside, graph = torch.cuda.Stream(device), torch.cuda.CUDAGraph()
        aside.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(aside):
            for _ in range(WARM_UP):
                work()
        torch.cuda.current_stream().wait_stream(aside)
        # its own stream: the one that PyTorch takes otherwise belongs to the GPU that was first recorded on
        with torch.cuda.graph(graph, stream=aside):
            work()
        return graph


@torch.no_grad()
def _copy(into: Sequence[Tensor], values: Sequence[Tensor]) -> None:
    for target, source in zip(into, values, strict=True):
        target.copy_(source)
