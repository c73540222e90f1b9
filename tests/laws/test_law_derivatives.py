"""The derivatives of the analytic laws, away from their kinks and on them, and their precision."""

import math

import pytest
import torch
from bodies import per_particle, principal, seeded, uniform
from law_checks import deformations, rotations, strains
from torch import Tensor

from pcnclaws.laws.elasticity import FixedCorotated, NeoHookean, StVKHencky
from pcnclaws.laws.moduli import lame_constants
from pcnclaws.laws.plasticity import DruckerPrager, Tresca, VonMises
from pcnclaws.tensors.linalg3 import deviator, exp_symmetric, identity_like, matmul, safe_norm

# PyTorch warns of its own use of torch.jit when it loads forward mode
pytestmark = [
    pytest.mark.usefixtures("each_backend"),
    pytest.mark.filterwarnings("ignore:`torch.jit.script` is deprecated:DeprecationWarning"),
]


def away_from_kinks() -> Tensor:
    """Clearly inside and clearly outside of the yield surface, among them equal and nearly equal stretches."""
    compressed = [
        principal(-0.02, -0.02, -0.02 + 1e-9),
        principal(-0.01, -0.01, -0.012),  # inside of both surfaces
        principal(0.05, -0.1, -0.1),
        principal(0.1, -0.2, -0.15),
        principal(-0.3, 0.1, 0.1),
    ]
    expanded = [principal(0.1, 0.1, 0.1), principal(0.2, -0.1, 0.05)]
    strain = torch.cat(compressed + expanded, dim=2)
    count = strain.shape[2]
    return matmul(matmul(rotations(7, count), exp_symmetric(strain)), rotations(8, count))


# moduli of order 1, so that finite differences with respect to them are accurate
UNIT = {"youngs_modulus": 2.0, "poissons_ratio": 0.3}
LAWS = {
    "fixed corotated": (FixedCorotated(), UNIT),
    "neo-Hookean": (NeoHookean(), UNIT),
    "StVK Hencky": (StVKHencky(), UNIT),
    "Drucker-Prager": (DruckerPrager(), UNIT | {"friction_angle": 30.0}),
    "von Mises": (VonMises(), UNIT | {"yield_stress": 0.05}),
    "Tresca": (Tresca(), UNIT | {"yield_stress": 0.05}),
}


@pytest.mark.parametrize("name", LAWS)
def test_derivatives_of_each_law_away_from_kinks(name: str) -> None:
    law, values = LAWS[name]
    f = away_from_kinks()
    parameters = per_particle(values, f.shape[2])

    def function(deformation: Tensor, *numbers: Tensor) -> Tensor:
        return law(deformation, dict(zip(values, numbers, strict=True)))

    inputs = [f, *parameters.values()]
    assert torch.autograd.gradcheck(function, [i.requires_grad_() for i in inputs], eps=1e-6, atol=1e-7, rtol=1e-6)
    tangents = [uniform(seeded(9), *i.shape) for i in inputs]
    forward = torch.func.jvp(function, tuple(i.detach() for i in inputs), tuple(tangents))[1]
    cotangent = uniform(seeded(10), *forward.shape)
    reverse = torch.func.vjp(function, *(i.detach() for i in inputs))[1](cotangent)
    backward = sum((r * t).sum() for r, t in zip(reverse, tangents, strict=True))
    torch.testing.assert_close((forward * cotangent).sum(), backward, rtol=1e-11, atol=1e-11)


def on_the_yield_surface(name: str) -> Tensor:
    """Strains on the kink: the tip of the cone, and points of the yield surface up to rounding."""
    direction = strains(11, 1.0, 20)
    direction = deviator(direction) / safe_norm(deviator(direction))
    lam, mu = (float(modulus[0]) for modulus in lame_constants(per_particle(UNIT, 1)))
    if name == "von Mises":
        return 0.05 / (2 * mu) * direction
    if name == "Tresca":
        values = torch.linalg.eigvalsh(direction.permute(2, 0, 1))
        hexagon = direction / (values[:, 2] - values[:, 0])
        corners = torch.cat((principal(1.0, 1.0, -2.0), principal(2.0, -1.0, -1.0)), dim=2) / 3.0
        return math.sqrt(2) * 0.05 / (2 * mu) * torch.cat((hexagon, corners), dim=2)
    alpha = math.sqrt(2 / 3) * 2 * 0.5 / (3 - 0.5)
    shear = (3 * lam + 2 * mu) / (2 * mu) * 0.06 * alpha
    return torch.cat((shear * direction - 0.02 * identity_like(direction), torch.zeros(3, 3, 1).double()), dim=2)


@pytest.mark.parametrize("name", ["Drucker-Prager", "von Mises", "Tresca"])
def test_at_the_kinks_the_derivative_is_finite_and_that_of_one_side(name: str) -> None:
    law, values = LAWS[name]
    f = exp_symmetric(on_the_yield_surface(name))
    parameters = per_particle(values, f.shape[2])
    change = matmul(strains(12, 1.0, f.shape[2]), f)
    tangent = torch.func.jvp(lambda d: law(d, parameters), (f,), (change,))[1]
    assert torch.isfinite(tangent).all()
    sides = [(law(f + step * change, parameters) - law(f, parameters)) / step for step in (1e-6, -1e-6)]
    nearest = torch.stack([(side - tangent).abs().amax((0, 1)) for side in sides]).amin(0)
    if name == "Drucker-Prager":
        # at the tip the derivative is that of the elastic side: nothing flows
        torch.testing.assert_close(tangent[:, :, -1], change[:, :, -1], rtol=0, atol=1e-12)
        nearest = nearest[:-1]
    if name == "Tresca":
        # at the two corners there are more sides than these two
        nearest = nearest[:-2]
    assert nearest.max() < 1e-4
    leaf = f.clone().requires_grad_()
    (gradient,) = torch.autograd.grad(law(leaf, parameters).sum(), leaf)
    assert torch.isfinite(gradient).all()


@pytest.mark.parametrize("name", LAWS)
def test_single_precision_is_as_good_as_its_input(name: str) -> None:
    law, values = LAWS[name]
    f = deformations(13, 0.3).float()
    single = law(f, per_particle(values, f.shape[2], torch.float32))
    double = law(f.double(), per_particle(values, f.shape[2]))
    assert single.dtype == torch.float32
    torch.testing.assert_close(single.double(), double, rtol=0, atol=2e-6)
