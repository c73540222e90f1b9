"""The kernels of laws and of the step on a GPU: sources shared with the CPU, a thread for every particle or node."""

import ctypes
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple, Protocol, runtime_checkable

import torch
from torch import Tensor

from pcnclaws.compiled.calls import address
from pcnclaws.compiled.gpu_build import Kernels, kernels_of
from pcnclaws.compiled.law_source import LawKernel
from pcnclaws.compiled.structures import Bodies, Corners, LawArrays, LawFields, Settings, weights_structure

NUMBERS = {torch.float32: "float", torch.float64: "double"}
LAYERS = 3  # of a network whose kernel runs on a GPU
ALIGNMENT = 32  # bytes
# Memory that the threads of a block share, on every GPU [bytes].
MOST_SHARED = 48 * 1024
# Particles whose gradients of the weights are summed together at least, and how many such sums there are at most.
CHUNK, MOST_CHUNKS = 256, 64
# The kernels of laws that have run in this process.
_used_laws: set[Kernels] = set()


class _Fields(ctypes.Structure):
    _fields_ = tuple((name, ctypes.c_void_p) for name in ("position", "velocity", "affine", "deformation", "stress"))


class _Moved(ctypes.Structure):
    _fields_ = (("velocity", ctypes.c_void_p), ("affine", ctypes.c_void_p))


# What comes back of a term of affine XPIC: Return in source/terms.hpp.
ADJOINT, TERM, LAST_TERM = range(3)
MOST_RETURNS = 3


class _Terms(ctypes.Structure):
    """Terms in source/terms.hpp."""

    _fields_ = (
        ("count", ctypes.c_int64),
        ("velocity", ctypes.c_void_p * MOST_RETURNS),
        ("gradient", ctypes.c_void_p * MOST_RETURNS),
    )


@runtime_checkable
class DescribedStep(Protocol):
    """The settings of a step: StepSettings of pcnclaws/compiled/step.py."""

    @property
    def walls(self) -> bytes:
        """What the nodes of the axes are."""
        ...

    @property
    def size(self) -> int:
        """Nodes of a scene."""
        ...

    @property
    def order(self) -> int:
        """Of the affine XPIC of the transfer, 1 for APIC."""
        ...

    def described(self, walls: int | None, window: bool) -> Settings:
        """As the kernels read it."""
        ...


class StepInput(NamedTuple):
    """A step on a GPU.

    settings  StepSettings
    bodies  scene_index, mass, volume (particles,) and gravity (3, scenes)
    state   position, velocity (3, particles), affine, deformation and stress (3, 3, particles)
    """

    settings: "DescribedStep"
    bodies: tuple[Tensor, ...]
    state: tuple[Tensor, ...]


class Nodes(NamedTuple):
    """What a step puts on the grid, (nodes of all scenes, 4).

    momentum  and mass [kg m/s, kg]
    moved     velocity after gravity and walls [m/s], and a number without meaning
    """

    momentum: Tensor
    moved: Tensor


class LawGradients(NamedTuple):
    """Gradients of a law's inputs; of the parameters and weights only where they were asked for."""

    deformation: Tensor
    internal: Tensor | None
    parameters: Tensor | None
    weights: list[Tensor]


def law_forward(law: LawKernel, given: LawArrays) -> tuple[Tensor, Tensor | None]:
    """The law, as isotropic_law in pcnclaws/compiled/isotropic_laws.py; all tensors contiguous."""
    result, kernels = given.like_result(law.after), _LawKernels(law, given)
    kernels.start("law_forward", given.deformation.shape[2], LawFields.of(*result))
    return result


def law_adjoint(
    law: LawKernel, given: LawArrays, incoming: tuple[Tensor, Tensor | None], wanted: tuple[bool, bool]
) -> LawGradients:
    """Gradients from those of the result. wanted: those of the parameters, those of the weights."""
    gradient, kernels = given.like_result(law.internal), _LawKernels(law, given)
    of_parameters = torch.empty_like(given.parameters) if wanted[0] else None
    memory = _NetworkMemory(given.weights if wanted[1] else (), given.deformation)
    arrays = LawFields.of(*incoming), LawFields.of(*gradient), address(of_parameters), memory.described()
    kernels.start("law_adjoint", max(given.deformation.shape[2], memory.stride), *arrays)
    return LawGradients(*gradient, of_parameters, memory.weight_gradients())


def fallbacks() -> int:
    """How many particles found their principal axes by the slow path, in the laws that ran on GPUs in this process."""
    return sum(kernels.counter("fallbacks") for kernels in _used_laws)


def step_forward(step: StepInput) -> tuple[tuple[Tensor, ...], Nodes]:
    """Position, velocity, affine and deformation after a step; and the nodes on the way, for step_adjoint."""
    after = tuple(torch.empty_like(field) for field in step.state[:4])
    kernels = _Step(step)
    nodes = kernels.nodes()
    kernels.each_particle("gather_state", kernels.state, address(nodes.moved), _fields(after))
    return after, nodes


def step_adjoint(
    step: StepInput, nodes: Nodes, velocity: Tensor, affine: Tensor, incoming: tuple[Tensor, ...]
) -> tuple[Tensor, ...]:
    """Gradients of the five fields of the state from those of the state after, whose velocities are given."""
    gradient = tuple(torch.empty_like(field) for field in step.state)
    kernels, given = _Step(step), _fields(incoming)
    node_gradients = torch.zeros_like(nodes.momentum)
    kernels.each_particle("scatter_gradient", kernels.state, given, address(node_gradients))
    kernels.each_node("adjoint_nodes", address(nodes.momentum), address(node_gradients))
    after = _Moved(velocity.data_ptr(), affine.data_ptr())
    kernels.gather_gradient(Nodes(node_gradients, nodes.moved), after, given, _fields(gradient))
    return gradient


def step_to_grid(step: StepInput, nodes: Tensor) -> None:
    """Momentum and mass of the nodes into nodes, 0 before, (nodes of all scenes, 4)."""
    _Step(step).to_grid(nodes)


def step_from_grid(step: StepInput, velocities: Tensor, after: tuple[Tensor, ...]) -> None:
    """The state after the step into `after`, from the velocities of the nodes."""
    kernels = _Step(step)
    kernels.each_particle("gather_state", kernels.state, address(velocities), _fields(after))


def step_to_node_velocities(step: StepInput, incoming: tuple[Tensor, ...], gradients: Tensor) -> None:
    """Gradients at the velocities of the nodes into `gradients`, 0 before, from those of the state after."""
    kernels = _Step(step)
    kernels.each_particle("scatter_gradient", kernels.state, _fields(incoming), address(gradients))


def step_gather_gradient(
    step: StepInput,
    nodes: Nodes,
    after: tuple[Tensor, ...],
    incoming: tuple[Tensor, ...],
    gradient: tuple[Tensor, ...],
) -> None:
    """Gradients of the five fields of the state into `gradient`; nodes: gradients at momentum and mass, velocities."""
    kernels = _Step(step)
    moved = _Moved(after[1].data_ptr(), after[2].data_ptr())
    kernels.gather_gradient(nodes, moved, _fields(incoming), _fields(gradient))


def failing(position: Tensor, deformation: Tensor, domain: Corners) -> Tensor:
    """As in pcnclaws/compiled/failing.py; contiguous tensors."""
    particles = position.shape[1]
    failed = torch.empty(particles, dtype=torch.bool, device=position.device)
    arrays = address(position), address(deformation), address(failed)
    _step_kernels(position).start("find_failing", particles, ctypes.c_int64(particles), domain, *arrays)
    return failed


class _Step:
    """Starts the kernels of a step, with what they all take."""

    def __init__(self, step: StepInput) -> None:
        scene, mass, volume, gravity = step.bodies
        particles, scenes = mass.numel(), gravity.shape[1]
        walls = _walls(step.settings.walls, mass.device)
        settings = step.settings.described(walls.data_ptr() if len(walls) else None, window=False)
        arrays = (tensor.data_ptr() for tensor in (scene, mass, volume, gravity))
        self._given = settings, Bodies(particles, scenes, *arrays)
        self._particles, self._node_count, self._order = particles, scenes * step.settings.size, step.settings.order
        self._like, self._kernels = mass, _step_kernels(mass)
        self.state = _fields(step.state)

    def nodes(self) -> Nodes:
        """Particles to grid, and the grid moved."""
        momentum = self._no_nodes()
        self.to_grid(momentum)
        moved = torch.empty_like(momentum)
        self.each_node("move_nodes", address(momentum), address(moved))
        return Nodes(momentum, moved)

    def to_grid(self, nodes: Tensor) -> list[Tensor]:
        """Momentum and mass of the nodes into nodes, 0 before; the terms of affine XPIC that went back."""
        self.each_particle("scatter_state", self.state, address(nodes))
        terms = [torch.empty_like(nodes) for _ in range(self._order - 1)]
        for k, term in enumerate(terms):
            if k == 0:
                self.each_node("begin_terms", address(nodes), address(term))
            following = terms[k + 1] if k + 1 < len(terms) else None
            change = self._returned(term, TERM if following is not None else LAST_TERM)
            self.each_node("add_term", address(nodes), address(term), address(change), address(following))
        return terms

    def gather_gradient(self, nodes: Nodes, after: _Moved, incoming: _Fields, gradient: _Fields) -> None:
        """Gradients of the fields of the state; nodes: gradients at momentum and mass, velocities."""
        gradients, terms = [nodes.momentum], []
        if self._order > 1:
            momentum = self._no_nodes()
            terms = self.to_grid(momentum)
            for term in reversed(terms):
                change, found = self._returned(gradients[0], ADJOINT), torch.empty_like(momentum)
                arrays = (momentum, nodes.momentum, gradients[0], change, term, found)
                self.each_node("find_term_gradient", *map(address, arrays))
                gradients.insert(0, found)
        described = _Terms(len(terms))
        for k, term in enumerate(terms):
            described.velocity[k], described.gradient[k] = term.data_ptr(), gradients[k + 1].data_ptr()
        arrays = address(nodes.moved), address(gradients[0]), gradient, described
        self.each_particle("gather_gradient", self.state, after, incoming, *arrays)

    def _returned(self, term: Tensor, what: int) -> Tensor:
        """What comes back to the nodes of a term."""
        change = self._no_nodes()
        self.each_particle("return_term", self.state, address(term), ctypes.c_int64(what), address(change))
        return change

    def _no_nodes(self) -> Tensor:
        return torch.zeros(self._node_count, 4, dtype=self._like.dtype, device=self._like.device)

    def each_particle(self, name: str, *arguments: object) -> None:
        self._kernels.start(name, self._particles, *self._given, *arguments)

    def each_node(self, name: str, *arguments: object) -> None:
        self._kernels.start(name, self._node_count, *self._given, *arguments)


class _NetworkMemory:
    """What the gradients of a network's weights are made of: NetworkMemory in source/thread_network.hpp.

    Its rows have whole chunks of particles, whose gradients of the weights are summed apart and then together: one sum
    over all particles would leave most of a GPU idle.
    """

    def __init__(self, weights: Sequence[Tensor], like: Tensor) -> None:
        self._weights, self.stride = weights, 0
        if not weights:
            return
        particles = like.shape[2]
        self._chunk = CHUNK * max(1, -(-particles // (CHUNK * MOST_CHUNKS)))
        self.stride = -(-particles // self._chunk) * self._chunk
        ins, outs = (sum(weight.shape[side] for weight in weights[:LAYERS]) for side in (1, 0))
        self._inputs, self._gradients = (like.new_empty(rows, self.stride) for rows in (ins + 1, outs))

    def described(self) -> "_NetworkMemoryStructure":
        """The structure that the kernel takes."""
        if not self._weights:
            return _NetworkMemoryStructure()
        return _NetworkMemoryStructure(self._inputs.data_ptr(), self._gradients.data_ptr(), self.stride)

    def weight_gradients(self) -> list[Tensor]:
        """Of the weights, then of the biases; none where no weights were given."""
        if not self._weights:
            return []
        inputs, gradients = (of.unflatten(1, (-1, self._chunk)) for of in (self._inputs, self._gradients))
        # one product of all layers with all, most of it for nothing, takes less time than several small ones
        products = torch.bmm(gradients.transpose(0, 1), inputs.permute(1, 2, 0)).sum(0)
        found, biases, row, column = [], [], 0, 0
        for weight, bias in zip(self._weights[:LAYERS], self._weights[LAYERS:], strict=True):
            rows, columns = weight.shape
            found.append(products[row : row + rows, column : column + columns])
            biases.append(products[row : row + rows, -1].view(bias.shape))
            row, column = row + rows, column + columns
        return found + biases


class _NetworkMemoryStructure(ctypes.Structure):
    _fields_ = (("inputs", ctypes.c_void_p), ("gradients", ctypes.c_void_p), ("stride", ctypes.c_int64))


class _LawKernels:
    """Starts the kernels of a law, with what they all take."""

    def __init__(self, law: LawKernel, given: LawArrays) -> None:
        deformation, parameters, internal, weights = given.deformation, given.parameters, given.internal, given.weights
        for tensor in (parameters, *weights) if internal is None else (parameters, internal, *weights):
            if (tensor.dtype, tensor.device) != (deformation.dtype, deformation.device):
                raise ValueError(
                    f"a law of {deformation.dtype} on {deformation.device} was given {tensor.dtype} on {tensor.device}"
                )
        if parameters.shape[0] != law.rows:
            raise ValueError(f"the law '{law.name}' reads {law.rows} rows of parameters, not {parameters.shape[0]}")
        if (0 if internal is None else len(internal)) != law.internal:
            raise ValueError(f"the law '{law.name}' reads {law.internal} internal variables")
        self.weights = _aligned(weights)
        units = (weights[0].shape[1], *(weight.shape[0] for weight in weights[:LAYERS])) if weights else (0, 0, 0, 0)
        macros: dict[str, object] = {f"UNITS_{layer}": count for layer, count in enumerate(units)}
        self._shared = 0
        if weights:
            # each begins at four whole numbers
            needed = sum(-(-weight.numel() // 4) * 4 for weight in weights) * deformation.element_size()
            if needed <= MOST_SHARED:
                macros["STAGED"], self._shared = 1, needed
        self._kernels = kernels_of("gpu_law.cu", deformation.device, law, NUMBER=NUMBERS[deformation.dtype], **macros)
        _used_laws.add(self._kernels)
        arrays = address(deformation), address(parameters), address(internal), weights_structure(LAYERS, self.weights)
        self._given = ctypes.c_int64(deformation.shape[2]), *arrays

    def start(self, name: str, threads: int, *arguments: object) -> None:
        self._kernels.start(name, threads, *self._given, *arguments, shared=self._shared)


def _step_kernels(like: Tensor) -> Kernels:
    return kernels_of("gpu_step.cu", like.device, NUMBER=NUMBERS[like.dtype])


def _aligned(weights: Sequence[Tensor]) -> list[Tensor]:
    """The weights, which kernels read four at a time, at addresses where they may: a view into another tensor may not
    begin at one.
    """
    return [weight if weight.data_ptr() % ALIGNMENT == 0 else weight.clone() for weight in weights]


@lru_cache(maxsize=256)
def _walls(walls: bytes, device: torch.device) -> Tensor:
    return torch.tensor(list(walls), dtype=torch.uint8, device=device)


def _fields(tensors: tuple[Tensor, ...]) -> _Fields:
    """The addresses of four or five fields."""
    return _Fields(*(tensor.data_ptr() for tensor in tensors))
