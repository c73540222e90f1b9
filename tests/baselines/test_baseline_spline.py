"""Splines: the right interval, exact for what they contain, and laws with the derivatives that they claim."""

import math

import pytest
import torch
from bodies import per_particle, seeded, uniform
from law_checks import COUNT, check_elasticity, check_plasticity, deformations
from torch import Tensor

from pcnclaws.baselines.spline import EnergyTerm, SplineElasticity, SplinePlasticity, spline
from pcnclaws.baselines.splines import cubic, cubic_integral, cubic_slope, knots_around_one, linear, locate
from pcnclaws.errors import UserError
from pcnclaws.laws.analytic import Laws
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.laws.plasticity import VonMises
from pcnclaws.tensors.linalg3 import exp_symmetric, identity_like, matmul, transpose

KNOTS = torch.tensor([0.5, 0.9, 1.0, 1.3, 2.0], dtype=torch.float64)


def of_cubic(x: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """A cubic polynomial, its derivative, and its integral from the first knot."""
    value, slope = x.pow(3) - 2.0 * x + 0.5, 3.0 * x.square() - 2.0
    integral = x.pow(4) / 4.0 - x.square() + 0.5 * x
    return value, slope, integral - (KNOTS[0].pow(4) / 4.0 - KNOTS[0].square() + 0.5 * KNOTS[0])


def random_laws(material: str, size: float) -> Laws:
    """Spline laws in float64 with random weights."""
    laws = spline(MATERIALS[material], {"knots": 9, "reach": 0.7})
    generator = seeded(3)
    with torch.no_grad():
        for law in laws:
            for weight in law.double().parameters() if law is not None else ():
                weight += size * uniform(generator, *weight.shape)
    return laws


def smooth_elasticity() -> SplineElasticity:
    """f' = (x - 1) + (x - 1)^2 / 2 and other quadratics, in Pa: a smooth energy that splines contain."""
    elastic = SplineElasticity(MATERIALS["elasticity"], 9, 0.7).double()
    for term, slope, curve in ((elastic.f, 1.0, 0.5), (elastic.g, 0.3, -0.2), (elastic.h, 0.7, 0.4)):
        term.scale = 1.0
        x = term.knots - 1.0
        term.secants.data, term.tangents.data = slope + curve * x, slope + 2.0 * curve * x
    return elastic


def energy_by_hand(stretches: Tensor) -> Tensor:
    """The energy of smooth_elasticity from stretches (3, particles)."""

    def term(x: Tensor, slope: float, curve: float) -> Tensor:
        return 0.5 * slope * (x - 1.0).square() + curve / 3.0 * (x - 1.0).pow(3)

    s0, s1, s2 = stretches
    pairs = term(s0 * s1, 0.3, -0.2) + term(s1 * s2, 0.3, -0.2) + term(s2 * s0, 0.3, -0.2)
    return term(stretches, 1.0, 0.5).sum(0) + pairs + term(s0 * s1 * s2, 0.7, 0.4)


def test_each_point_finds_its_interval() -> None:
    x = torch.tensor([0.5, 0.89, 0.9, 0.95, 1.0, 1.1, 1.3, 1.9, 2.0, 0.1, 5.0], dtype=torch.float64)
    place = locate(x, KNOTS)
    assert place.interval.tolist() == [0, 0, 1, 1, 2, 2, 3, 3, 3, 0, 3]
    torch.testing.assert_close(KNOTS[place.interval] + place.t * place.width + place.beyond, x)
    assert (place.t >= 0.0).all()
    assert (place.t <= 1.0).all()
    assert (place.beyond != 0.0).tolist() == [False] * 9 + [True] * 2


def test_a_cubic_is_reproduced_at_and_between_knots() -> None:
    values, slopes, _ = of_cubic(KNOTS)
    x = torch.cat((KNOTS, torch.linspace(0.5, 2.0, 61, dtype=torch.float64)))
    place = locate(x, KNOTS)
    expected, slope, integral = of_cubic(x)
    torch.testing.assert_close(cubic(place, values, slopes), expected, rtol=1e-13, atol=1e-13)
    torch.testing.assert_close(cubic_slope(place, values, slopes), slope, rtol=1e-12, atol=1e-12)
    torch.testing.assert_close(cubic_integral(place, values, slopes, KNOTS), integral, rtol=1e-13, atol=1e-13)


def test_beyond_the_knots_a_spline_is_a_straight_line_without_a_jump() -> None:
    values, slopes, _ = of_cubic(KNOTS)
    low, high = torch.tensor([0.5, 0.3], dtype=torch.float64), torch.tensor([2.0, 2.4], dtype=torch.float64)
    for x, end in ((low, 0), (high, -1)):
        line = values[end] + slopes[end] * (x - KNOTS[end])
        torch.testing.assert_close(cubic(locate(x, KNOTS), values, slopes), line)
    x = torch.tensor([0.2, 0.6, 1.7, 3.0], dtype=torch.float64, requires_grad=True)
    integral = cubic_integral(locate(x, KNOTS), values, slopes, KNOTS)
    (slope,) = torch.autograd.grad(integral.sum(), x)
    torch.testing.assert_close(slope, cubic(locate(x, KNOTS), values, slopes).detach())
    bent = linear(locate(torch.tensor([0.95, 3.0]).double(), KNOTS), KNOTS.square())
    assert bent.tolist() == pytest.approx([0.5 * (0.81 + 1.0), 4.0 + (4.0 - 1.69) / 0.7])


def test_knots_crowd_around_one() -> None:
    knots = knots_around_one(25, 1.0)
    assert knots[12] == 1.0
    assert (float(knots[0]), float(knots[-1])) == pytest.approx((math.exp(-1.0), math.exp(1.0)))
    widths = knots[1:] - knots[:-1]
    assert (widths > 0.0).all()
    assert widths[12] < 0.003
    with pytest.raises(ValueError, match="no middle one"):
        knots_around_one(8, 1.0)


def test_a_known_separable_energy_and_its_stress_are_reproduced() -> None:
    elastic = smooth_elasticity()
    f = deformations(1, 0.2).requires_grad_()  # stretches, their products and volumes lie among the knots
    stretches = torch.linalg.svdvals(f.permute(2, 0, 1)).T
    expected = energy_by_hand(stretches)
    torch.testing.assert_close(elastic.energy(f), expected, rtol=1e-12, atol=1e-12)
    (first_piola,) = torch.autograd.grad(expected.sum(), f)
    tau = matmul(first_piola, transpose(f.detach()))
    torch.testing.assert_close(elastic(f, {}).detach(), tau, rtol=1e-10, atol=1e-11)


def test_the_stress_is_the_derivative_of_the_energy_whatever_the_weights() -> None:
    elastic = random_laws("plasticine", 0.3).elasticity
    assert isinstance(elastic, SplineElasticity)
    f = deformations(2, 0.3).requires_grad_()
    (first_piola,) = torch.autograd.grad(elastic.energy(f).sum(), f)
    unit = elastic.f.scale
    tau = matmul(first_piola, transpose(f.detach()))
    torch.testing.assert_close(elastic(f, {}).detach() / unit, tau / unit, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("stretches", [(1.0, 1.0, 1.0), (1.2, 1.2, 0.9), (1.2, 1.20001, 0.9), (1.3, 1.1, 0.8)])
def test_the_stress_has_its_exact_derivative_also_where_stretches_meet(stretches: tuple[float, ...]) -> None:
    elastic = smooth_elasticity()
    f = torch.diag(torch.tensor(stretches, dtype=torch.float64))[:, :, None].clone().requires_grad_()
    assert torch.autograd.gradcheck(lambda f: elastic(f, {}), (f,))


def test_the_laws_obey_what_laws_must() -> None:
    values = MATERIALS["sand"].defaults
    check_elasticity(smooth_elasticity(), MATERIALS["elasticity"].defaults, keeps_moduli=False)
    laws = random_laws("sand", 0.4)
    check_elasticity(laws.elasticity, values, keeps_moduli=False)
    assert laws.plasticity is not None
    check_plasticity(laws.plasticity, values, idempotent=False)


def test_the_return_contains_von_mises() -> None:
    values = per_particle(MATERIALS["plasticine"].defaults, COUNT)
    plastic = SplinePlasticity(MATERIALS["plasticine"], 9, 0.7).double()
    limit = values["yield_stress"][0] * (1.0 + values["poissons_ratio"][0]) / values["youngs_modulus"][0]
    plastic.shear.data = (limit / (5e-3 + 0.3 * (-plastic.knots).clamp_min(0.0))).sqrt()
    plastic.loss.data.zero_()
    for size in (0.002, 0.1):
        f = deformations(4, size)
        torch.testing.assert_close(plastic(f, values), VonMises()(f, values), rtol=0, atol=1e-9)


def test_the_return_has_its_exact_derivative() -> None:
    plastic = random_laws("sand", 0.2).plasticity
    assert plastic is not None
    f = deformations(5, 0.1)[:, :, :4].clone().requires_grad_()
    assert torch.autograd.gradcheck(lambda f: plastic(f, {}), (f,))


def test_the_untrained_law_is_a_body_of_the_middle_of_the_ranges() -> None:
    elastic = SplineElasticity(MATERIALS["elasticity"], 25, 1.0).double()
    check_elasticity(elastic, MATERIALS["elasticity"].defaults)
    assert isinstance(elastic.f, EnergyTerm)
    strain = 1e-4 * identity_like(deformations(6, 0.1)).repeat(1, 1, COUNT)
    assert (elastic.energy(exp_symmetric(strain)) > 0.0).all()


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"knots": 8, "reach": 1.0}, r"model\.knots=8"),
        ({"knots": 9, "reach": 0.0}, r"model\.reach=0\.0"),
        ({"knots": True, "reach": 1.0}, r"model\.knots=True"),
    ],
)
def test_wrong_fields_are_refused(fields: dict[str, object], message: str) -> None:
    with pytest.raises(UserError, match=message):
        spline(MATERIALS["sand"], fields)
