"""NCLaws as the reference describes them: features, networks, and how they are trained."""

from dataclasses import replace
from math import cos, pi

import pytest
import torch
from bodies import per_particle
from law_checks import COUNT, deformations, rotations, strains
from training_bodies import SETTINGS, recorded

from pcnclaws.baselines.nclaws import FEATURES, NCLawsNetwork, features_and_rotation, nclaws
from pcnclaws.baselines.polar import stretches_and_rotation
from pcnclaws.commands.models import build_model
from pcnclaws.data.dataset import SegmentDataset
from pcnclaws.data.segments import SegmentPlan
from pcnclaws.errors import UserError
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.tensors.linalg3 import determinant, exp_symmetric, identity_like, matmul, transpose
from pcnclaws.training.module import OptimiserSettings
from pcnclaws.training.single_scene import SingleSceneModule


def test_features_are_stretches_shear_and_volume_and_vanish_at_rest() -> None:
    f = deformations(1, 0.3)
    features, rotation = features_and_rotation(f)
    assert features.shape == (FEATURES, COUNT)
    singular = torch.linalg.svdvals(f.permute(2, 0, 1)).T
    torch.testing.assert_close(features[:3], singular - 1.0, rtol=0, atol=1e-12)
    shear = matmul(transpose(f), f) - identity_like(f)
    torch.testing.assert_close(features[3:12], shear.reshape(9, COUNT), rtol=0, atol=1e-12)
    torch.testing.assert_close(features[12], determinant(f) - 1.0, rtol=0, atol=1e-12)
    torch.testing.assert_close(features_and_rotation(rotation)[0], torch.zeros_like(features), rtol=0, atol=1e-12)


def test_the_rotation_is_that_of_the_polar_decomposition() -> None:
    turn, stretch = rotations(2), exp_symmetric(strains(3, 0.3))
    _, rotation = stretches_and_rotation(matmul(turn, stretch))
    torch.testing.assert_close(rotation, turn, rtol=0, atol=1e-12)


def test_stretches_and_rotation_have_their_exact_derivatives() -> None:
    f = deformations(4, 0.3)[:, :, :4].clone().requires_grad_()
    assert torch.autograd.gradcheck(stretches_and_rotation, (f,))
    equal = identity_like(f).repeat(1, 1, 2).requires_grad_()
    assert torch.autograd.gradcheck(lambda f: stretches_and_rotation(f)[1], (equal,))
    (slope,) = torch.autograd.grad(stretches_and_rotation(equal)[0].sum(), equal)
    assert torch.isfinite(slope).all()


def test_a_state_that_is_not_finite_stays_so_and_disturbs_no_other() -> None:
    f = deformations(5, 0.1)
    broken = f.clone()
    broken[0, 0, 3] = float("nan")
    network = NCLawsNetwork().double()
    expected, found = network(f), network(broken)
    assert torch.isnan(found[:, :, 3]).all()
    torch.testing.assert_close(found[:, :, 4:], expected[:, :, 4:])


def test_networks_have_the_size_of_the_reference() -> None:
    network = NCLawsNetwork()
    assert [tuple(weight.shape) for weight in network.parameters()] == [(64, 13), (64, 64), (9, 64)]
    assert sum(weight.numel() for weight in network.parameters()) == 5504
    for weight in network.parameters():  # Xavier uniform: uniform up to sqrt(6 / (inputs + outputs))
        bound = (6.0 / sum(weight.shape)) ** 0.5
        assert weight.abs().max() <= bound
        assert weight.detach().std() == pytest.approx(bound / 3.0**0.5, rel=0.1)


def test_laws_are_objective_and_rest_at_rest() -> None:
    laws = nclaws(MATERIALS["sand"])
    assert laws.plasticity is not None
    elastic, plastic = laws.elasticity.double(), laws.plasticity.double()
    values, f, turn = per_particle(MATERIALS["sand"].defaults, COUNT), deformations(6, 0.2), rotations(7)
    stress = elastic(f, values)
    torch.testing.assert_close(
        elastic(matmul(turn, f), values), matmul(matmul(turn, stress), transpose(turn)), rtol=0, atol=1e-12
    )
    torch.testing.assert_close(plastic(matmul(turn, f), values), matmul(turn, plastic(f, values)), rtol=0, atol=1e-12)
    torch.testing.assert_close(elastic(turn, values), torch.zeros_like(turn), rtol=0, atol=1e-12)
    torch.testing.assert_close(plastic(turn, values), turn, rtol=0, atol=1e-14)
    assert nclaws(MATERIALS["elasticity"]).plasticity is None


def test_a_batch_is_the_whole_motion_restarted_from_recorded_states() -> None:
    scene = recorded(1)[0]  # 40 steps, full states every 10
    data = SegmentDataset([scene], SegmentPlan(3, None, first=15, last=20))
    first, last = data[0], data[2]
    assert first.steps == 15
    assert first.start.scenes.scene_count == 4  # from steps 0, 10, 20 and 30: no gap between them
    assert last.steps == 20
    assert last.start.scenes.scene_count == 2
    assert bool(torch.isnan(first.target[-1, :, 3 * 64 :]).all())  # 5 steps beyond the end of the motion
    assert not bool(torch.isnan(first.target[:, :, : 3 * 64]).any())
    assert torch.equal(first.start.state.position, data[0].start.state.position)


def test_segments_grow_by_a_cosine() -> None:
    plan = SegmentPlan(300, None, first=25, last=200)
    for iteration in (0, 75, 150, 299):
        expected = 25 + 175 * 0.5 * (1.0 - cos(pi * iteration / 299))
        assert abs(plan.length(iteration, 5, 500) - expected) <= 2.5


def test_each_law_has_its_own_learning_rate_and_clip() -> None:
    laws = nclaws(MATERIALS["sand"])
    assert laws.plasticity is not None
    settings = OptimiserSettings(1.0, gradient_clip=0.1, loss="absolute", loss_scale=1e4, plastic_learning_rate=0.1)
    assert settings.scale == 1e4
    module = SingleSceneModule(laws, [SETTINGS], settings, 300)
    optimiser = module.configure_optimizers()["optimizer"]
    assert [group["lr"] for group in optimiser.param_groups] == [1.0, 0.1]
    for law, size in ((laws.elasticity, 5.0), (laws.plasticity, 0.01)):
        for weight in law.parameters():
            weight.grad = torch.full_like(weight, size)
    module.configure_gradient_clipping(optimiser, 0.1)
    norms = [
        torch.nn.utils.get_total_norm([weight.grad for weight in law.parameters() if weight.grad is not None])
        for law in (laws.elasticity, laws.plasticity)
    ]
    assert [float(norm) for norm in norms] == pytest.approx([0.1, 0.1], rel=1e-4)
    with pytest.raises(UserError, match=r"training\.plastic_learning_rate=0\.0"):
        replace(settings, plastic_learning_rate=0.0)


def test_a_baseline_takes_no_fields_that_it_does_not_have() -> None:
    with pytest.raises(UserError, match="model='width' is not known; accepted: name"):
        build_model(MATERIALS["sand"], {"name": "nclaws", "width": 64})
