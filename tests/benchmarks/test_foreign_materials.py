"""The materials of other forms obey what laws must, and their closed forms."""

import math

import pytest
import torch
from bodies import per_particle, principal
from law_checks import check_elasticity, check_plasticity

from benchmarks.foreign_materials import COMPACTION, FOREIGN, CappedDruckerPrager, Hosford, MatsuokaNakai, Ogden
from benchmarks.mohr_coulomb import MohrCoulomb
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.moduli import lame_constants
from pcnclaws.laws.plasticity import strain_at_yield


# radial return to Mohr-Coulomb's pyramid reaches it in one step, and its edges too
@pytest.mark.parametrize("name", FOREIGN)
def test_every_law_obeys_what_laws_must(name: str) -> None:
    material = FOREIGN[name]
    laws = analytic_laws(material)
    check_elasticity(laws.elasticity, material.defaults)
    if laws.plasticity is not None:
        check_plasticity(laws.plasticity, material.defaults)


def test_ogdens_stress_on_principal_axes() -> None:
    """tau_i = K ln J + sum_p mu_p (l_i^a_p - sum_j l_j^a_p / 3), with l = J^(-1/3) times the stretches."""
    stretches, parameters = (0.7, 1.1, 1.4), per_particle({"youngs_modulus": 3e5, "poissons_ratio": 0.3}, 1)
    lam, mu = (float(modulus[0]) for modulus in lame_constants(parameters))
    j = math.prod(stretches)
    unit = 2.0 * mu / sum(Ogden.moduli)
    expected = [(lam + 2.0 / 3.0 * mu) * math.log(j)] * 3
    for a, m in zip(Ogden.exponents, Ogden.moduli, strict=True):
        powers = [(s / j ** (1.0 / 3.0)) ** a for s in stretches]
        expected = [t + unit * m / a * (one - sum(powers) / 3.0) for t, one in zip(expected, powers, strict=True)]
    torch.testing.assert_close(Ogden()(principal(*stretches), parameters), principal(*expected), rtol=1e-11, atol=1e-6)


def test_the_cap_bears_no_more_compression() -> None:
    parameters = per_particle(FOREIGN["cap"].defaults, 1)
    after = CappedDruckerPrager()(principal(*[math.exp(-COMPACTION)] * 3), parameters)
    torch.testing.assert_close(after, principal(*[math.exp(-COMPACTION / 3.0)] * 3), rtol=1e-12, atol=1e-12)


def test_hosfords_metal_lies_between_von_mises_and_tresca() -> None:
    """In uniaxial strain the limit is that of pure shear for von Mises, 1.06 of it here, 2/sqrt(3) for Tresca."""
    values = FOREIGN["hosford"].defaults
    limit = float(strain_at_yield(per_particle(values, 1))[0])
    for direction, expected in (((1.0, 0.0, -1.0), 1.0), ((2.0, -1.0, -1.0), _hosford_limit())):
        length = math.sqrt(sum(d * d for d in direction))
        trial = principal(*(math.exp(3.0 * limit * d / length) for d in direction))
        after = Hosford()(trial, per_particle(values, 1)).diagonal(dim1=0, dim2=1).log()
        assert float(after.norm()) == pytest.approx(expected * limit, rel=1e-12)
    assert 1.0 < _hosford_limit() < 2.0 / math.sqrt(3.0)


def _hosford_limit() -> float:
    """|dev h| where the two equal differences of (2, -1, -1)/sqrt(6) reach what pure shear's reach."""
    return (129.0 / 16.0) ** 0.125 / (3.0 / math.sqrt(6.0))


def test_matsuoka_and_nakais_surface_meets_mohr_coulombs_edges_in_compression_and_extension() -> None:
    values = {"youngs_modulus": 3e5, "poissons_ratio": 0.2, "friction_angle": 30.0}
    parameters = per_particle(values, 1)
    for axis in ((-2.0, 1.0, 1.0), (2.0, -1.0, -1.0)):
        trial = principal(*(math.exp(-0.01 + 0.02 * a) for a in axis))
        found = [law(trial, parameters).diagonal(dim1=0, dim2=1).log() for law in (MatsuokaNakai(), MohrCoulomb())]
        torch.testing.assert_close(found[0], found[1], rtol=0, atol=1e-12)
