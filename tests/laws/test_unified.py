"""The unified material is each of its kinds where it has nothing else, and stays bounded in between."""

from typing import Any

import numpy as np
import pytest
import torch
from bodies import per_particle
from law_checks import COUNT, check_elasticity, check_plasticity, deformations
from test_laws_neural import with_random_weights
from torch import Tensor

import pcnclaws as pc
from pcnclaws.errors import UserError
from pcnclaws.evaluation.energy import potential_energy, scene_energy
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.laws.neural import build_neural_laws
from pcnclaws.simulation.batch import batch_scenes
from pcnclaws.simulation.scenes import restarted
from pcnclaws.tensors.linalg3 import hencky_strain

UNIFIED = MATERIALS["unified"]
OWN: dict[str, Any] = {
    "youngs_modulus": 3e5,
    "poissons_ratio": 0.3,
    "yield_stress": 4e3,
    "friction_angle": 30.0,
}
KINDS = {
    "elasticity": {"plasticine_share": 0.0, "sand_share": 0.0},
    "plasticine": {"plasticine_share": 1.0, "sand_share": 0.0},
    "sand": {"plasticine_share": 0.0, "sand_share": 1.0},
}
BETWEEN = {
    "halfway between plasticine and sand": {"plasticine_share": 0.5, "sand_share": 0.5},
    "a third of each": {"plasticine_share": 0.3, "sand_share": 0.3},
    "half elastic, half sand": {"plasticine_share": 0.0, "sand_share": 0.5},
    "half elastic, half plasticine": {"plasticine_share": 0.5, "sand_share": 0.0},
}


def of_kind(kind: str) -> dict[str, Any]:
    """The values that the material of that name reads itself."""
    return {name: OWN[name] for name in MATERIALS[kind].parameter_names}


@pytest.mark.parametrize("kind", list(KINDS))
@pytest.mark.parametrize("size", [0.005, 0.05, 0.5])
@pytest.mark.usefixtures("each_backend")
def test_where_there_is_one_kind_alone_the_law_is_that_of_its_material(kind: str, size: float) -> None:
    f = deformations(61, size)
    alone, unified = analytic_laws(MATERIALS[kind]), analytic_laws(UNIFIED)
    own, all_of_it = per_particle(of_kind(kind), COUNT), per_particle(OWN | KINDS[kind], COUNT)
    expected = alone.elasticity(f, own)
    torch.testing.assert_close(unified.elasticity(f, all_of_it), expected, rtol=1e-15, atol=1e-9)
    assert unified.plasticity is not None
    returned = unified.plasticity(f, all_of_it)
    if alone.plasticity is None:
        assert torch.equal(returned, f)
    else:
        torch.testing.assert_close(returned, alone.plasticity(f, own), rtol=0, atol=1e-14)


@pytest.mark.parametrize("kind", list(KINDS))
def test_each_kind_obeys_what_laws_must(kind: str) -> None:
    laws = analytic_laws(UNIFIED)
    check_elasticity(laws.elasticity, OWN | KINDS[kind])
    assert laws.plasticity is not None
    check_plasticity(laws.plasticity, OWN | KINDS[kind])


@pytest.mark.parametrize("shares", list(BETWEEN.values()), ids=list(BETWEEN))
def test_what_lies_between_kinds_obeys_what_laws_must_but_for_a_second_return_that_flows_on(
    shares: dict[str, float],
) -> None:
    laws = analytic_laws(UNIFIED)
    check_elasticity(laws.elasticity, OWN | shares)
    assert laws.plasticity is not None
    check_plasticity(laws.plasticity, OWN | shares, idempotent=False)


def test_stress_and_strain_after_flow_are_the_means_of_those_of_the_kinds() -> None:
    f, laws = deformations(62, 0.2), analytic_laws(UNIFIED)
    mixed = per_particle(OWN | {"plasticine_share": 0.2, "sand_share": 0.5}, COUNT)
    each = {kind: (analytic_laws(MATERIALS[kind]), per_particle(of_kind(kind), COUNT)) for kind in KINDS}
    weights = {"elasticity": 0.3, "plasticine": 0.2, "sand": 0.5}
    stress = sum(weights[kind] * own.elasticity(f, values) for kind, (own, values) in each.items())
    torch.testing.assert_close(laws.elasticity(f, mixed), stress, rtol=1e-12, atol=1e-6)
    strains = [
        weights[kind] * hencky_strain(own.plasticity(f, values) if own.plasticity is not None else f)
        for kind, (own, values) in each.items()
    ]
    assert laws.plasticity is not None
    torch.testing.assert_close(hencky_strain(laws.plasticity(f, mixed)), sum(strains), rtol=0, atol=1e-11)


def test_the_stress_between_kinds_is_the_derivative_of_an_energy() -> None:
    law = analytic_laws(UNIFIED).elasticity
    values = per_particle(OWN | {"plasticine_share": 0.2, "sand_share": 0.3}, COUNT)
    f = deformations(63, 0.3).requires_grad_()
    (slope,) = torch.autograd.grad(law.energy_density(f, values).sum(), f)
    tau = torch.einsum("ijp,kjp->ikp", slope, f.detach())
    torch.testing.assert_close(tau, law.kirchhoff_stress(f.detach(), values), rtol=1e-9, atol=1e-5)


def test_shares_that_are_more_than_the_whole_are_divided_by_their_sum() -> None:
    f, law = deformations(64, 0.2).movedim(-1, 0), pc.analytic_law("unified")
    half, both = ({**OWN, "plasticine_share": share, "sand_share": share} for share in (0.5, 1.0))
    assert torch.equal(law.stress(f, **half), law.stress(f, **both))
    assert torch.equal(law.return_map(f, **half), law.return_map(f, **both))


@pytest.mark.parametrize("share", [-0.1, 1.01])
def test_shares_below_nothing_and_above_the_whole_are_refused(share: float) -> None:
    with pytest.raises(UserError, match="sand_share.*at least 0 and at most 1"):
        pc.analytic_law("unified").stress(torch.eye(3), **OWN, plasticine_share=0.0, sand_share=share)


UNREAD = {
    "elasticity": {"yield_stress": 7e3, "friction_angle": 20.0},
    "plasticine": {"friction_angle": 20.0},
    "sand": {"yield_stress": 7e3},
}


@pytest.mark.parametrize("kind", list(KINDS))
@pytest.mark.parametrize("network", [None, "pcnclaws_unified"])
@pytest.mark.usefixtures("each_backend")
def test_what_a_kind_does_not_read_changes_nothing(kind: str, network: str | None) -> None:
    laws = analytic_laws(UNIFIED) if network is None else with_random_weights("unified", network, 0.3)
    f = deformations(65, 0.2)
    one, other = (per_particle(OWN | KINDS[kind] | changed, COUNT) for changed in ({}, UNREAD[kind]))
    for law in laws[:2]:
        assert law is not None
        assert torch.equal(law(f, one), law(f, other))


@pytest.mark.usefixtures("each_backend")
def test_an_elastic_body_does_not_yield_whatever_the_weights_are() -> None:
    law, f = with_random_weights("unified", "pcnclaws_unified", 0.5).plasticity, deformations(66, 0.5)
    assert law is not None
    assert torch.equal(law(f, per_particle(OWN | KINDS["elasticity"], COUNT)), f)
    assert not torch.equal(law(f, per_particle(OWN | KINDS["sand"], COUNT)), f)


@pytest.mark.parametrize("shares", [*KINDS.values(), *BETWEEN.values()], ids=[*KINDS, *BETWEEN])
@pytest.mark.usefixtures("each_backend")
def test_the_networks_obey_what_laws_must_at_any_shares(shares: dict[str, float]) -> None:
    laws = with_random_weights("unified", "pcnclaws_unified", 0.3)
    check_elasticity(laws.elasticity, OWN | shares)
    assert laws.plasticity is not None
    check_plasticity(laws.plasticity, OWN | shares, idempotent=False)


def test_the_networks_are_one_pair_whatever_the_kind() -> None:
    laws = build_neural_laws(UNIFIED, {"name": "pcnclaws_unified", "width": 16})
    assert laws.plasticity is not None
    for law in laws[:2]:
        assert law is not None
        assert [name for name, _ in law.named_children() if name == "network"] == ["network"]
        assert law.kernel is not None


def test_the_networks_of_the_unified_material_are_refused_for_another_one() -> None:
    with pytest.raises(UserError, match="pcnclaws_unified.*'sand'.*accepted: material=unified"):
        pc.neural_law("sand", "pcnclaws_unified")
    with pytest.raises(UserError, match="pcnclaws_unified.*'elasticity'"):
        pc.neural_law("elasticity", "pcnclaws_unified")


def energies(scene: pc.Scene, steps: int) -> np.ndarray:
    """Kinetic, elastic and potential energy over a motion [J]; the elastic one is the analytic law's."""
    motion = scene.simulate(steps=steps, every=10, dtype=torch.float64, deformation=True)
    keyframes = motion.record.keyframes
    assert keyframes is not None
    found = []
    for row in range(len(keyframes.step)):
        start = restarted(scene._start, keyframes, row)
        batch = batch_scenes([start], torch.float64)
        elasticity, settings = analytic_laws(UNIFIED).elasticity, start.settings
        lively = scene_energy(batch.state, batch.scenes, batch.parameters, elasticity, settings.grid_spacing)
        found.append(float(lively + potential_energy(batch.state, batch.scenes, settings.floor)))
    return np.array(found)


@pytest.mark.slow
@pytest.mark.parametrize("shares", list(BETWEEN.values()), ids=list(BETWEEN))
@pytest.mark.parametrize("network", [None, "pcnclaws_unified"])
def test_bodies_between_kinds_that_fall_stay_finite_and_gain_no_energy(
    network: str | None, shares: dict[str, Any]
) -> None:
    law = pc.analytic_law("unified") if network is None else pc.neural_law("unified", network)
    body = pc.Body.cube(side=0.3, centre=(0.5, 0.3, 0.5), particles_per_edge=6)
    scene = pc.Scene(body, law, velocity=(1.0, -2.0, -1.0), spin=(2.0, 2.0, 2.0), **OWN, **shares)
    found = energies(scene, 500)
    assert np.isfinite(found).all()
    assert found.max() <= 1.01 * found[0]
    assert found.min() >= 0.0


def test_a_body_of_two_kinds_has_both_at_once() -> None:
    """The shares may differ from particle to particle: the elastic half keeps its F, the other one flows."""
    f, law = deformations(67, 0.3).movedim(-1, 0), pc.analytic_law("unified")
    sand = torch.zeros(COUNT, dtype=torch.float64)
    sand[COUNT // 2 :] = 1.0
    shares: dict[str, Any] = {"plasticine_share": 0.0, "sand_share": sand}
    returned: Tensor = law.return_map(f, **OWN, **shares)
    assert torch.equal(returned[: COUNT // 2], f[: COUNT // 2])
    alone = pc.analytic_law("sand").return_map(f, **of_kind("sand"))
    torch.testing.assert_close(returned[COUNT // 2 :], alone[COUNT // 2 :], rtol=0, atol=1e-14)
