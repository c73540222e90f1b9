"""The derivatives of one step with respect to everything that enters it."""

from collections.abc import Callable

import pytest
import torch
from bodies import NO_GRAVITY, analytic_simulator, per_particle, seeded, uniform
from torch import Tensor

from pcnclaws.mpm.contact import VERSION_1_STICK
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.mpm.state import ParticleState, Scenes
from pcnclaws.simulation.simulator import Simulator

# PyTorch warns of its own use of torch.jit when it loads forward mode
pytestmark = [
    pytest.mark.usefixtures("each_backend"),
    pytest.mark.filterwarnings("ignore:`torch.jit.script` is deprecated:DeprecationWarning"),
]

PARTICLES = 4
# well inside or outside of the yield surface, so that the kinks of plasticity are away
PARAMETERS = {
    "elasticity": {"youngs_modulus": 2.0, "poissons_ratio": 0.3},
    "plasticine": {"youngs_modulus": 2.0, "poissons_ratio": 0.25, "yield_stress": 0.05},
    "sand": {"youngs_modulus": 2.0, "poissons_ratio": 0.2, "friction_angle": 25.0},
    "neo_hookean": {"youngs_modulus": 2.0, "poissons_ratio": 0.3},
    "tresca": {"youngs_modulus": 2.0, "poissons_ratio": 0.25, "yield_stress": 0.05},
}
NUMBERS = ("position", "velocity", "affine", "deformation", "mass", "volume", "gravity")
Numbers = dict[str, Tensor]


def numbers_of_two_scenes(material: str) -> Numbers:
    """Everything that a step depends on, of order 1, two scenes that touch a wall, positions inside their cells."""
    generator = seeded(11)
    cells = torch.tensor([[3, 3, 4, 3], [2, 3, 2, 2], [4, 4, 5, 4]])
    identity = torch.eye(3, dtype=torch.float64)[:, :, None]
    return {
        # between the cell edges of the quadratic splines, which lie halfway between nodes
        "position": (cells + 0.3 * uniform(generator, 3, PARTICLES)) / 8,
        "velocity": uniform(generator, 3, PARTICLES) - torch.tensor([[0.0], [3.0], [0.0]]),
        "affine": uniform(generator, 3, 3, PARTICLES),
        "deformation": 0.95 * identity + 0.15 * uniform(generator, 3, 3, PARTICLES),
        "mass": uniform(generator, PARTICLES, low=0.5, high=1.5),
        "volume": uniform(generator, PARTICLES, low=0.5, high=1.5),
        "gravity": uniform(generator, 3, 2),
    } | per_particle(PARAMETERS[material], PARTICLES)


def stepped(simulator: Simulator, numbers: Numbers) -> Tensor:
    """All numbers of the state after a step."""
    state = ParticleState(*(numbers[name] for name in NUMBERS[:4]))
    scenes = Scenes(torch.tensor([0, 0, 1, 1]), numbers["mass"], numbers["volume"], numbers["gravity"])
    parameters = {name: value for name, value in numbers.items() if name not in NUMBERS}
    return torch.cat([field.flatten() for field in simulator(state, scenes, parameters)])


def step_of(material: str, boundary: str = "separate", transfer: str = "apic") -> Simulator:
    settings = SimulationSettings(0.01, 1 / 8, 0.25, NO_GRAVITY, boundary, transfer=transfer)
    return analytic_simulator(material, settings)


def as_function_of(
    name: str, material: str, boundary: str = "separate", transfer: str = "apic"
) -> tuple[Callable[[Tensor], Tensor], Tensor]:
    """The step as a function of one of its inputs, and the input."""
    numbers, simulator = numbers_of_two_scenes(material), step_of(material, boundary, transfer)
    return lambda value: stepped(simulator, numbers | {name: value}), numbers[name]


CASES = [(material, name) for material in PARAMETERS for name in (*NUMBERS, *PARAMETERS[material])]


@pytest.mark.parametrize(("material", "name"), CASES)
def test_the_derivatives_of_a_step_are_those_of_finite_differences(material: str, name: str) -> None:
    function, value = as_function_of(name, material)
    # every single derivative of elasticity, random projections of the others, whose laws are checked on their own
    fast = material != "elasticity"
    assert torch.autograd.gradcheck(function, value.requires_grad_(), eps=1e-6, atol=1e-7, rtol=1e-6, fast_mode=fast)


@pytest.mark.parametrize("transfer", ["axpic2", "axpic3"])
@pytest.mark.parametrize("name", [*NUMBERS, "youngs_modulus"])
def test_the_derivatives_hold_with_affine_xpic(name: str, transfer: str) -> None:
    function, value = as_function_of(name, "elasticity", transfer=transfer)
    fast = (name, transfer) != ("position", "axpic2")
    assert torch.autograd.gradcheck(function, value.requires_grad_(), eps=1e-6, atol=1e-7, rtol=1e-6, fast_mode=fast)


@pytest.mark.parametrize("name", ["position", "velocity", "deformation"])
def test_the_derivatives_hold_at_stick_walls(name: str) -> None:
    function, value = as_function_of(name, "elasticity", VERSION_1_STICK)
    assert torch.autograd.gradcheck(function, value.requires_grad_(), eps=1e-6, atol=1e-7, rtol=1e-6)


@pytest.mark.parametrize(("material", "name"), CASES)
def test_forward_mode_equals_reverse_mode(material: str, name: str) -> None:
    function, value = as_function_of(name, material)
    generator = seeded(12)
    tangent = uniform(generator, *value.shape)
    forward = torch.func.jvp(function, (value,), (tangent,))[1]
    cotangent = uniform(generator, *forward.shape)
    (reverse,) = torch.func.vjp(function, value)[1](cotangent)
    torch.testing.assert_close((forward * cotangent).sum(), (reverse * tangent).sum(), rtol=1e-10, atol=1e-11)


def test_derivatives_are_finite_at_the_undeformed_start_of_a_scene() -> None:
    for material in PARAMETERS:
        numbers = numbers_of_two_scenes(material)
        start = ParticleState.at_rest_shape(numbers["position"], numbers["velocity"])
        numbers |= {"affine": start.affine, "deformation": start.deformation}
        numbers = {name: value.float().requires_grad_() for name, value in numbers.items()}
        out = stepped(step_of(material), numbers)
        gradients = torch.autograd.grad(out.sum(), list(numbers.values()))
        for name, gradient in zip(numbers, gradients, strict=True):
            assert torch.isfinite(gradient).all(), (material, name)
