"""Any number of threads gives the same bits: of motions, of gradients, of trained weights' gradients."""

from collections.abc import Iterator

import pytest
import torch
from conftest import SLOW_IN_PYTORCH

import pcnclaws as pc


@pytest.fixture(autouse=True)
def _threads_as_before() -> Iterator[None]:
    before = torch.get_num_threads()
    yield
    torch.set_num_threads(before)


def motion_and_gradients(law: pc.ConstitutiveModel) -> list[torch.Tensor]:
    stamp = pc.Collider.plane((0.5, 0.13, 0.5), (0.1, 1.0, 0.0), friction=0.2)
    body = pc.Body.cube(side=0.3, centre=(0.5, 0.31, 0.5), particles_per_edge=8)
    stiffness = torch.full((len(body),), 3e5, requires_grad=True)
    scene = pc.Scene(body, law, velocity=(0, -2, 0), spin=(0, 2, 0), youngs_modulus=stiffness)
    found = []
    for one in (scene, scene.with_(colliders=[stamp])):
        moved = one.simulate(10, 10, deformation=True)
        found += [moved.position, moved.velocity, moved.deformation]
    weights = [weight for weight in law.parameters() if weight.requires_grad]
    positions = scene.rollout(10, 10)
    return [*found, positions.detach(), *torch.autograd.grad(positions.square().mean(), [stiffness, *weights])]


@SLOW_IN_PYTORCH
@pytest.mark.parametrize("law", ["analytic", "neural"])
def test_one_two_and_three_threads_give_the_same_bits(law: str, each_backend: str) -> None:
    made = pc.load_law("sand").requires_grad_() if law == "neural" else pc.analytic_law("plasticine")
    found = []
    for threads in (1, 2, 3):
        torch.set_num_threads(threads)
        found.append(motion_and_gradients(made))
    # with PyTorch's own steps the gradients of weights are its matrix products, whose sums its threads divide
    of_weights = len([one for one in made.parameters() if one.requires_grad]) if each_backend == "torch" else 0
    exact = len(found[0]) - of_weights
    for several in found[1:]:
        assert all(torch.equal(a, b) for a, b in zip(several[:exact], found[0][:exact], strict=True))
        for a, b in zip(several[exact:], found[0][exact:], strict=True):
            assert (a - b).abs().max() <= 1e-6 * b.abs().max()
