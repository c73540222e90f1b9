"""The paper's networks: their polar decomposition, their kernel, and what they keep whatever their weights are."""

import pytest
import torch
from bodies import per_particle, seeded
from law_checks import COUNT, deformations
from torch import Tensor, nn
from torch.autograd import forward_ad, gradcheck

import pcnclaws as pc
from pcnclaws.compiled.backend import using_backend
from pcnclaws.compiled.stretch_law import stretch_law_serves
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.laws.neural import build_neural_laws
from pcnclaws.laws.neural_paper import StretchNet
from pcnclaws.laws.rotation import rotation_and_stretch
from pcnclaws.tensors.linalg3 import identity_like, matmul, transpose


def laws_of(material: str, dtype: torch.dtype = torch.float64) -> list[StretchNet]:
    """The laws with weights at random, of a width that is no multiple of a vector."""
    laws, generator = build_neural_laws(MATERIALS[material], {"name": "pcnclaws_paper", "width": 13}), seeded(50)
    found: list[StretchNet] = [law for law in (laws.elasticity, laws.plasticity) if isinstance(law, StretchNet)]
    for law in found:
        for weight in law.to(dtype).parameters():
            nn.init.normal_(weight, std=0.4, generator=generator)
    return found


# PyTorch warns of its own use of torch.jit when it loads forward mode
@pytest.mark.filterwarnings("ignore:`torch.jit.script` is deprecated:DeprecationWarning")
def test_the_polar_decomposition_has_its_derivatives_where_stretches_coincide() -> None:
    f = torch.cat((identity_like(deformations(51, 0.3)), deformations(51, 0.3)[:, :, :4]), 2).requires_grad_()
    rotation, stretch = rotation_and_stretch(f)
    torch.testing.assert_close(matmul(rotation, stretch), f)
    torch.testing.assert_close(matmul(transpose(rotation), rotation), identity_like(f).expand_as(f))
    assert gradcheck(rotation_and_stretch, (f,))
    tangent, adjoint = (torch.randn(f.shape, generator=seeded(57 + k), dtype=f.dtype) for k in range(2))
    with forward_ad.dual_level():
        rates = [forward_ad.unpack_dual(one).tangent for one in rotation_and_stretch(forward_ad.make_dual(f, tangent))]
    for value, rate in zip((rotation, stretch), rates, strict=True):
        (gradient,) = torch.autograd.grad((value * adjoint).sum(), f, retain_graph=True)
        assert rate is not None
        torch.testing.assert_close((gradient * tangent).sum(), (rate * adjoint).sum())


@pytest.mark.parametrize("material", ["elasticity", "plasticine", "sand"])
def test_their_kernel_computes_what_pytorch_does_with_every_derivative(material: str) -> None:
    f = torch.cat((deformations(52, 0.2), 0.02 * deformations(53, 3.0)), 2)[:, :, : COUNT + 5]
    f = torch.cat((f, identity_like(f)), 2)
    direction = torch.randn(f.shape, generator=seeded(54), dtype=f.dtype)
    parameters = per_particle(MATERIALS[material].defaults, f.shape[2])
    for law in laws_of(material):
        inputs = [f, *(parameters[name] for name in law.parameter_names)]
        assert stretch_law_serves(f, law.kernel_rows(parameters), law.network.all_weights)
        kernel, reference = (_derivatives(law, inputs, direction, backend) for backend in ("compiled", "torch"))
        for one, other in zip(kernel, reference, strict=True):
            torch.testing.assert_close(one, other, rtol=1e-9, atol=1e-9 * float(reference[0].abs().max()))


def _derivatives(law: StretchNet, inputs: list[Tensor], direction: Tensor, backend: str) -> list[Tensor]:
    """The result, and its gradients by F, physical parameters and weights."""
    given = [value.clone().requires_grad_() for value in inputs]
    with using_backend(backend):
        result = law(given[0], dict(zip(law.parameter_names, given[1:], strict=True)))
        gradients = torch.autograd.grad((result * direction).sum(), [*given, *law.parameters()])
    return [result.detach(), *gradients]


@pytest.mark.usefixtures("each_backend")
@pytest.mark.parametrize("material", ["elasticity", "plasticine", "sand"])
def test_an_undeformed_body_feels_nothing_whatever_the_weights_are(material: str) -> None:
    rest = identity_like(deformations(55, 0.1)).repeat(1, 1, COUNT)
    parameters = per_particle(MATERIALS[material].defaults, COUNT)
    for law in laws_of(material):
        expected = rest if law.returns_strain else torch.zeros_like(rest)
        torch.testing.assert_close(law(rest, parameters), expected, rtol=0.0, atol=1e-9)


def test_stress_is_in_units_of_youngs_modulus_but_for_what_the_network_makes_of_it() -> None:
    (law,) = laws_of("elasticity")
    with torch.no_grad():
        law.network.weights[0][:, -2] = 0.0  # deaf to E
    f, defaults = deformations(56, 0.1), MATERIALS["elasticity"].defaults
    soft, stiff = (per_particle(defaults | {"youngs_modulus": e}, COUNT) for e in (1e4, 1e6))
    torch.testing.assert_close(100.0 * law(f, soft), law(f, stiff))


@pytest.mark.parametrize("material", ["elasticity", "plasticine", "sand"])
def test_a_drop_of_the_untrained_law_stays_a_simulation(material: str) -> None:
    body = pc.Body.cube(side=0.2, centre=(0.5, 0.3, 0.5), particles_per_edge=4)
    scene = pc.Scene(body, pc.neural_law(material, "pcnclaws_paper"), velocity=(0.0, -2.0, 0.0))
    position = scene.simulate(steps=300, every=100).position
    assert torch.isfinite(position).all()
    assert float(position[-1, :, 1].min()) > 0.0
    assert float(position[-1, :, 1].max()) < 0.3  # untrained, it does not hold itself up
