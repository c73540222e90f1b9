"""The neural laws keep what their structure promises, whatever their weights are."""

import pytest
import torch
from bodies import per_particle, seeded
from law_checks import COUNT, check_elasticity, check_plasticity, deformations, rotations

from pcnclaws.errors import UserError
from pcnclaws.laws.analytic import Laws
from pcnclaws.laws.elasticity import StVKHencky
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.laws.neural import build_neural_laws
from pcnclaws.laws.neural_free_flow import FreeFlowPlasticNet
from pcnclaws.laws.registry import NETWORKS
from pcnclaws.tensors.linalg3 import deviator, hencky_strain, identity_like, matmul, safe_norm, transpose

pytestmark = pytest.mark.usefixtures("each_backend")


def with_random_weights(material: str, name: str, size: float) -> Laws:
    """Neural laws in float64 whose weights are displaced at random."""
    laws, generator = build_neural_laws(MATERIALS[material], {"name": name, "width": 16}), seeded(40)
    with torch.no_grad():
        for law in laws:
            for weight in law.double().parameters() if law is not None else ():
                weight += size * torch.randn(weight.shape, generator=generator, dtype=torch.float64)
    return laws


@pytest.mark.parametrize("size", [0.0, 0.3])
@pytest.mark.parametrize("name", ["pcnclaws", "pcnclaws_energy", "pcnclaws_free_flow", "pcnclaws_no_prior"])
@pytest.mark.parametrize("material", list(MATERIALS))
def test_the_laws_obey_what_laws_must(material: str, name: str, size: float) -> None:
    laws = with_random_weights(material, name, size)
    check_elasticity(
        laws.elasticity,
        MATERIALS[material].defaults,
        keeps_moduli=name != "pcnclaws_no_prior",
        rounding=1e-11 if name == "pcnclaws_energy" else 1e-14,  # sums of exponentials cancel
    )
    if laws.plasticity is not None:
        # the learned yield surface depends on the strain itself, so that a second return may flow a little more
        check_plasticity(laws.plasticity, MATERIALS[material].defaults, idempotent=False)


def test_the_untrained_default_elasticity_is_the_hencky_law() -> None:
    laws, parameters = with_random_weights("elasticity", "pcnclaws", 0.0), MATERIALS["elasticity"].defaults
    f, values = deformations(41, 0.2), per_particle(parameters, COUNT)
    torch.testing.assert_close(laws.elasticity(f, values), StVKHencky()(f, values), rtol=1e-9, atol=1e-6)


def test_at_strains_that_no_data_shows_a_trained_elasticity_returns_to_the_hencky_law() -> None:
    laws, parameters = with_random_weights("elasticity", "pcnclaws", 0.3), MATERIALS["elasticity"].defaults
    strain = torch.tensor([-5.0, -20.0, 8.0, 2.0], dtype=torch.float64)
    f = torch.eye(3, dtype=torch.float64)[:, :, None] * strain.exp()
    f[0, 0] = (0.5 * strain).exp()
    values = {name: torch.full((4,), value, dtype=torch.float64) for name, value in parameters.items()}
    f.requires_grad_()
    stress, hencky = laws.elasticity(f, values), StVKHencky()(f, values)
    for particle, tolerance in enumerate((0.05, 0.01, 0.02, 1.0)):
        error = (stress - hencky)[:, :, particle].norm() / hencky[:, :, particle].norm()
        assert float(error.detach()) < tolerance
    (slope,) = torch.autograd.grad(stress.sum(), f)
    assert torch.isfinite(slope).all()


def test_without_prior_the_untrained_laws_know_nothing_of_the_parameters() -> None:
    laws, material = with_random_weights("plasticine", "pcnclaws_no_prior", 0.0), MATERIALS["plasticine"]
    assert laws.plasticity is not None
    f = deformations(41, 0.2)
    low, high = ({name: span[end] for name, span in material.ranges.items()} for end in (0, 1))
    for law in (laws.elasticity, laws.plasticity):
        torch.testing.assert_close(law(f, per_particle(low, COUNT)), law(f, per_particle(high, COUNT)))
    # 2 mu = K
    hencky = {"youngs_modulus": 9.0 / 7.0 * material.defaults["youngs_modulus"], "poissons_ratio": 2.0 / 7.0}
    expected = StVKHencky()(f, per_particle(hencky, COUNT))
    torch.testing.assert_close(laws.elasticity(f, per_particle(low, COUNT)), expected, rtol=1e-9, atol=1e-6)


def test_a_free_flow_that_is_not_turned_is_the_radial_return() -> None:
    parameters = per_particle(MATERIALS["tresca"].defaults, COUNT)
    radial, free = (with_random_weights("tresca", name, 0.0).plasticity for name in ("pcnclaws", "pcnclaws_free_flow"))
    assert radial is not None
    assert free is not None
    f = deformations(44, 0.2)
    torch.testing.assert_close(free(f, parameters), radial(f, parameters), rtol=1e-12, atol=1e-12)


def test_a_turned_flow_keeps_the_size_of_shear_and_changes_its_direction() -> None:
    law, parameters = with_random_weights("tresca", "pcnclaws_free_flow", 0.0).plasticity, MATERIALS["tresca"].defaults
    assert isinstance(law, FreeFlowPlasticNet)
    f, values = deformations(44, 0.2), per_particle(parameters, COUNT)
    with torch.no_grad():
        radial = deviator(hencky_strain(law(f, values)))
        law.network.biases[-1][3] = 0.05
        turned = deviator(hencky_strain(law(f, values)))
    torch.testing.assert_close(safe_norm(turned), safe_norm(radial), rtol=1e-8, atol=1e-12)
    cosine = (turned * radial).sum((0, 1)) / safe_norm(radial).square()
    assert float(cosine.min()) > 0.0
    assert float(cosine.min()) < 0.9  # nowhere near the radius


@pytest.mark.parametrize("name", ["pcnclaws", "pcnclaws_energy", "pcnclaws_free_flow", "pcnclaws_no_prior"])
def test_the_networks_are_told_every_parameter(name: str) -> None:
    laws, material = with_random_weights("plasticine", name, 0.3), MATERIALS["plasticine"]
    assert laws.plasticity is not None
    f = deformations(41, 0.05)
    for law, names in ((laws.elasticity, ("youngs_modulus", "poissons_ratio")), (laws.plasticity, material.ranges)):
        for changed in names:
            other = material.defaults | {changed: material.ranges[changed][1]}
            one, two = (law(f, per_particle(values, COUNT)) for values in (material.defaults, other))
            assert (one - two).abs().max() > 1e-6 * one.abs().max(), changed


@pytest.mark.parametrize("material", list(MATERIALS))
def test_the_laws_of_the_paper_are_objective_and_differentiable_at_rest(material: str) -> None:
    laws = with_random_weights(material, "pcnclaws_paper", 0.1)
    f, turn = deformations(42, 0.1), rotations(43)
    parameters = per_particle(MATERIALS[material].defaults, COUNT)
    stress = laws.elasticity(f, parameters)
    turned = matmul(matmul(turn, stress), transpose(turn))
    torch.testing.assert_close(laws.elasticity(matmul(turn, f), parameters), turned, rtol=0, atol=1e-4)
    rest = identity_like(f).repeat(1, 1, COUNT).requires_grad_()
    total = laws.elasticity(rest, parameters).sum()
    if laws.plasticity is not None:
        elastic = laws.plasticity(f, parameters)
        torch.testing.assert_close(laws.plasticity(matmul(turn, f), parameters), matmul(turn, elastic))
        total = total + laws.plasticity(rest, parameters).sum()
    (gradient,) = torch.autograd.grad(total, rest)
    assert torch.isfinite(gradient).all()


# all but the one that is for bodies of any kind
@pytest.mark.parametrize("name", sorted(set(NETWORKS) - {"pcnclaws_unified"}))
def test_an_elastic_material_has_no_plastic_network(name: str) -> None:
    assert build_neural_laws(MATERIALS["elasticity"], {"name": name}).plasticity is None


@pytest.mark.parametrize(
    ("model", "named"),
    [
        ({"name": "pcnclaw"}, "did you mean 'pcnclaws'"),
        ({"name": "pcnclaws", "widht": 3}, "did you mean 'width'"),
        ({"name": "pcnclaws", "width": 0}, "model.width=0"),
        ({"name": "pcnclaws", "width": "64"}, "model.width=64"),
    ],
)
def test_a_model_that_is_not_known_is_refused_by_name(model: dict[str, object], named: str) -> None:
    with pytest.raises(UserError, match=named):
        build_neural_laws(MATERIALS["sand"], model)
