"""The kernels of laws and of the step on a GPU: sources shared with the CPU, a thread for every particle or node."""

import ctypes
from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import torch
from torch import Tensor

from pcnclaws.compiled.gpu_build import Kernels, kernels_of
from pcnclaws.compiled.kernels import address
from pcnclaws.compiled.structures import LAYERS, Bodies, Settings, Weights

NUMBERS = {torch.float32: "float", torch.float64: "double"}
# Nodes of an axis beyond the cells: one at the end of the domain, and one of padding on each side.
MORE_NODES = 3


class _Fields(ctypes.Structure):
    _fields_ = tuple((name, ctypes.c_void_p) for name in ("position", "velocity", "affine", "deformation", "stress"))


class _Moved(ctypes.Structure):
    _fields_ = (("velocity", ctypes.c_void_p), ("affine", ctypes.c_void_p))


class StepInput(NamedTuple):
    """A step on a GPU.

    walls   as in StepSettings
    bodies  scene_index, mass, volume (particles,) and gravity (3, scenes)
    state   position, velocity (3, particles), affine, deformation and stress (3, 3, particles)
    """

    time_step: float
    nodes: int
    stick: bool
    walls: bytes
    bodies: tuple[Tensor, ...]
    state: tuple[Tensor, ...]


class LawGradients(NamedTuple):
    """Gradients of a law's inputs; of the parameters and weights only where they were asked for."""

    deformation: Tensor
    parameters: Tensor | None
    weights: list[Tensor]


def law_forward(law: str, deformation: Tensor, parameters: Tensor, weights: Sequence[Tensor]) -> Tensor:
    """The law, as isotropic_law in pcnclaws/compiled/laws.py; all tensors contiguous."""
    result, particles = torch.empty_like(deformation), deformation.shape[2]
    arrays = address(deformation), address(parameters), _weights(weights), address(result)
    _law(law, deformation, parameters, weights).start("law_forward", particles, ctypes.c_int64(particles), *arrays)
    return result


def law_adjoint(
    law: str,
    deformation: Tensor,
    parameters: Tensor,
    weights: Sequence[Tensor],
    incoming: Tensor,
    wanted: tuple[bool, bool],
) -> LawGradients:
    """Gradients from those of the result. wanted: those of the parameters, those of the weights."""
    particles = deformation.shape[2]
    gradient = torch.empty_like(deformation)
    of_parameters = torch.empty_like(parameters) if wanted[0] else None
    inputs, gradients = _network_memory(weights, deformation)
    _law(law, deformation, parameters, weights).start(
        "law_adjoint",
        particles,
        ctypes.c_int64(particles),
        *(address(deformation), address(parameters), _weights(weights)),
        *(address(incoming), address(gradient), address(of_parameters), address(inputs), address(gradients)),
    )
    of_weights = _weight_gradients(weights, inputs, gradients) if wanted[1] else []
    return LawGradients(gradient, of_parameters, of_weights)


def step_forward(step: StepInput) -> tuple[Tensor, ...]:
    """Position, velocity, affine and deformation after a step."""
    after = tuple(torch.empty_like(field) for field in step.state[:4])
    _Step(step).forward(after)
    return after


def step_adjoint(step: StepInput, velocity: Tensor, affine: Tensor, incoming: tuple[Tensor, ...]) -> tuple[Tensor, ...]:
    """Gradients of the five fields of the state from those of the state after, whose velocities are given."""
    gradient = tuple(torch.empty_like(field) for field in step.state)
    _Step(step).adjoint(velocity, affine, incoming, gradient)
    return gradient


def failing(position: Tensor, deformation: Tensor) -> Tensor:
    """As in pcnclaws/compiled/failing.py; contiguous tensors."""
    particles = position.shape[1]
    failed = torch.empty(particles, dtype=torch.bool, device=position.device)
    arrays = address(position), address(deformation), address(failed)
    _step_kernels(position).start("find_failing", particles, ctypes.c_int64(particles), *arrays)
    return failed


class _Step:
    """The kernels of a step, with what they all take."""

    def __init__(self, step: StepInput) -> None:
        scene, mass, volume, gravity = step.bodies
        self._particles, scenes = mass.numel(), gravity.shape[1]
        self._node_count = scenes * (step.nodes + MORE_NODES) ** 3
        walls = _walls(step.walls, mass.device)
        settings = Settings(step.time_step, step.nodes, step.stick, False, walls.data_ptr())
        arrays = (tensor.data_ptr() for tensor in (scene, mass, volume, gravity))
        self._given = settings, Bodies(self._particles, scenes, *arrays)
        self._state, self._kernels = _fields(step.state), _step_kernels(mass)
        # momentum and mass of the nodes
        self._nodes = self._zeros(mass)
        self._moved = torch.empty_like(self._nodes)
        self._each_particle("scatter_state", self._state, address(self._nodes))
        self._each_node("move_nodes", address(self._nodes), address(self._moved))

    def forward(self, after: tuple[Tensor, ...]) -> None:
        self._each_particle("gather_state", self._state, address(self._moved), _fields(after))

    def adjoint(
        self, velocity: Tensor, affine: Tensor, incoming: tuple[Tensor, ...], gradient: tuple[Tensor, ...]
    ) -> None:
        node_gradients, given = self._zeros(velocity), _fields(incoming)
        self._each_particle("scatter_gradient", self._state, given, address(node_gradients))
        self._each_node("adjoint_nodes", address(self._nodes), address(node_gradients))
        after = _Moved(velocity.data_ptr(), affine.data_ptr())
        arrays = address(self._moved), address(node_gradients), _fields(gradient)
        self._each_particle("gather_gradient", self._state, after, given, *arrays)

    def _zeros(self, like: Tensor) -> Tensor:
        return torch.zeros(self._node_count, 4, dtype=like.dtype, device=like.device)

    def _each_particle(self, name: str, *arguments: object) -> None:
        self._kernels.start(name, self._particles, *self._given, *arguments)

    def _each_node(self, name: str, *arguments: object) -> None:
        self._kernels.start(name, self._node_count, *self._given, *arguments)


def _law(law: str, deformation: Tensor, parameters: Tensor, weights: Sequence[Tensor]) -> Kernels:
    """The kernels of a law; ValueError for parameters or a network that do not fit."""
    macros = {"LAW": law, "ROWS": parameters.shape[0], "UNITS_1": 1, "UNITS_2": 1}
    if weights:
        macros |= {"UNITS_1": weights[0].shape[0], "UNITS_2": weights[1].shape[0]}
    return kernels_of("gpu_law.cu", deformation.device, NUMBER=NUMBERS[deformation.dtype], **macros)


def _step_kernels(like: Tensor) -> Kernels:
    return kernels_of("gpu_step.cu", like.device, NUMBER=NUMBERS[like.dtype])


def _weights(weights: Sequence[Tensor]) -> Weights:
    described = Weights()
    for layer in range(len(weights) // 2):
        described.weights[layer] = weights[layer].data_ptr()
        described.biases[layer] = weights[LAYERS + layer].data_ptr()
        described.sizes[layer + 1] = weights[layer].shape[0]
    return described


def _network_memory(weights: Sequence[Tensor], like: Tensor) -> tuple[Tensor | None, Tensor | None]:
    """Memory for the inputs of a network's layers with a row of ones, and for the gradients at their outputs."""
    if not weights:
        return None, None
    ins, outs = (sum(weight.shape[side] for weight in weights[:LAYERS]) for side in (1, 0))
    particles = like.shape[2]
    return like.new_empty(ins + 1, particles), like.new_empty(outs, particles)


def _weight_gradients(weights: Sequence[Tensor], inputs: Tensor | None, gradients: Tensor | None) -> list[Tensor]:
    if inputs is None or gradients is None:
        return []
    # one product of all layers with all, most of it for nothing, takes less time than several small ones
    products = gradients @ inputs.T
    found, biases, row, column = [], [], 0, 0
    for weight in weights[:LAYERS]:
        rows, columns = weight.shape
        found.append(products[row : row + rows, column : column + columns].reshape(weight.shape))
        biases.append(products[row : row + rows, -1:].reshape(weights[LAYERS + len(biases)].shape))
        row, column = row + rows, column + columns
    return found + biases


@cache
def _walls(walls: bytes, device: torch.device) -> Tensor:
    return torch.tensor(list(walls), dtype=torch.uint8, device=device)


def _fields(tensors: tuple[Tensor, ...]) -> _Fields:
    """The addresses of four or five fields."""
    return _Fields(*(tensor.data_ptr() for tensor in tensors))
