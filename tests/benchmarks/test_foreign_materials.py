"""The materials of other forms obey what laws must, and their closed forms."""

import math

import pytest
import torch
from bodies import per_particle, principal
from law_checks import check_elasticity, check_plasticity

from benchmarks.foreign_materials import COMPACTION, FOREIGN, CappedDruckerPrager, Ogden
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.moduli import lame_constants


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
