"""The analytic laws: what every law obeys, and their closed forms."""

import math

import pytest
import torch
from bodies import per_particle, principal
from law_checks import check_elasticity, check_plasticity, deformations, rotations, strains
from torch import Tensor

from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.base import Plasticity
from pcnclaws.laws.elasticity import FixedCorotated, NeoHookean, StVKHencky
from pcnclaws.laws.materials import MATERIALS, Material
from pcnclaws.laws.moduli import lame_constants
from pcnclaws.laws.plasticity import DruckerPrager, Tresca, VonMises
from pcnclaws.tensors.linalg3 import (
    deviator,
    exp_symmetric,
    hencky_strain,
    identity_like,
    matmul,
    safe_norm,
    trace,
    transpose,
)

pytestmark = pytest.mark.usefixtures("each_backend")

HOOKE = {"youngs_modulus": 3e5, "poissons_ratio": 0.3}
SAND = HOOKE | {"friction_angle": 30.0}
PLASTICINE = HOOKE | {"yield_stress": 4e3}


def corners(material: Material) -> list[dict[str, float]]:
    """Parameters at the two ends of the ranges of a material."""
    return [{name: ends[i] for name, ends in material.ranges.items()} for i in (0, 1)]


# what lies between the kinds of a material that holds several is in test_unified.py
SINGLE = [name for name, material in MATERIALS.items() if not material.kinds]
PARAMETERS_OF_ALL = [(name, values) for name in SINGLE for values in corners(MATERIALS[name])]


@pytest.mark.parametrize(("material", "values"), PARAMETERS_OF_ALL)
def test_every_law_obeys_what_laws_must(material: str, values: dict[str, float]) -> None:
    laws = analytic_laws(MATERIALS[material])
    check_elasticity(laws.elasticity, values)
    if laws.plasticity is not None:
        check_plasticity(laws.plasticity, values)


@pytest.mark.parametrize("elasticity", [FixedCorotated(), NeoHookean(), StVKHencky()])
@pytest.mark.parametrize("poissons_ratio", [-0.9, 0.0, 0.49])
def test_elasticity_holds_for_every_poissons_ratio(elasticity: FixedCorotated, poissons_ratio: float) -> None:
    check_elasticity(elasticity, {"youngs_modulus": 1e5, "poissons_ratio": poissons_ratio})


def test_hencky_elasticity_in_uniaxial_stress_is_youngs_modulus_times_logarithmic_strain() -> None:
    for strain in (-1.0, -1e-3, 0.5):
        deformation = principal(math.exp(strain), math.exp(-0.3 * strain), math.exp(-0.3 * strain))
        stress = StVKHencky()(deformation, per_particle(HOOKE, 1))
        torch.testing.assert_close(stress, principal(3e5 * strain, 0.0, 0.0), rtol=0, atol=3e5 * 1e-12)


def test_fixed_corotated_stress_on_principal_axes() -> None:
    stretches, parameters = (0.6, 1.1, 1.5), per_particle(HOOKE, 1)
    lam, mu = (float(modulus[0]) for modulus in lame_constants(parameters))
    j = math.prod(stretches)
    expected = principal(*(2 * mu * (s - 1) * s + lam * j * (j - 1) for s in stretches))
    torch.testing.assert_close(FixedCorotated()(principal(*stretches), parameters), expected, rtol=1e-12, atol=1e-7)


def stress_after(plasticity: Plasticity, trial_strain: Tensor, values: dict[str, float]) -> Tensor:
    """Stress [Pa] that is left of a trial strain."""
    parameters = per_particle(values, trial_strain.shape[2])
    return StVKHencky()(plasticity(exp_symmetric(trial_strain), parameters), parameters)


def test_neo_hookean_stress_on_principal_axes() -> None:
    stretches, parameters = (0.6, 1.1, 1.5), per_particle(HOOKE, 1)
    lam, mu = (float(modulus[0]) for modulus in lame_constants(parameters))
    expected = principal(*(mu * (s**2 - 1) + lam * math.log(math.prod(stretches)) for s in stretches))
    torch.testing.assert_close(NeoHookean()(principal(*stretches), parameters), expected, rtol=1e-12, atol=1e-7)


@pytest.mark.parametrize(("plasticity", "axial"), [(VonMises(), math.sqrt(1.5) * 4e3), (Tresca(), math.sqrt(2) * 4e3)])
def test_axial_stress_at_yield_in_uniaxial_stress(plasticity: Plasticity, axial: float) -> None:
    bulk = 3e5 / (3 * (1 - 2 * 0.3))
    for sign in (1.0, -1.0):
        trial = sign * (0.1 * principal(2.0, -1.0, -1.0) + axial / (9 * bulk) * principal(1.0, 1.0, 1.0))
        stress = stress_after(plasticity, trial, PLASTICINE)
        torch.testing.assert_close(stress, principal(sign * axial, 0.0, 0.0), rtol=0, atol=1e-6)


@pytest.mark.parametrize("plasticity", [VonMises(), Tresca()])
def test_shear_stress_at_yield(plasticity: Plasticity) -> None:
    sheared = torch.zeros(3, 3, 1, dtype=torch.float64)
    sheared[0, 1] = sheared[1, 0] = 0.1
    stress = stress_after(plasticity, sheared, PLASTICINE)
    torch.testing.assert_close(stress, sheared / 0.1 * (4e3 / math.sqrt(2)), rtol=0, atol=1e-6)


def test_von_mises_keeps_the_pressure_and_bounds_the_shear_stress() -> None:
    trial = strains(1, 0.1)
    stress, elastic = (
        stress_after(VonMises(), trial, PLASTICINE),
        StVKHencky()(exp_symmetric(trial), per_particle(PLASTICINE, trial.shape[2])),
    )
    shear = safe_norm(deviator(stress))
    torch.testing.assert_close(trace(stress), trace(elastic), rtol=1e-10, atol=1e-6)
    torch.testing.assert_close(shear, safe_norm(deviator(elastic)).clamp_max(4e3), rtol=1e-10, atol=0)


def test_tresca_keeps_the_pressure_and_gives_the_nearest_admissible_stress() -> None:
    trial = torch.cat((strains(1, 0.1), strains(2, 0.01), strains(3, 0.03)), dim=2)
    stress, elastic = (
        stress_after(Tresca(), trial, PLASTICINE),
        StVKHencky()(exp_symmetric(trial), per_particle(PLASTICINE, trial.shape[2])),
    )
    torch.testing.assert_close(trace(stress), trace(elastic), rtol=1e-10, atol=1e-6)
    kept, before = (torch.linalg.eigvalsh(deviator(tau).permute(2, 0, 1)) for tau in (stress, elastic))
    limit = math.sqrt(2) * 4e3
    largest = kept[:, 2] - kept[:, 0]
    torch.testing.assert_close(largest, (before[:, 2] - before[:, 0]).clamp_max(limit), rtol=1e-10, atol=0)
    # the nearest point of a convex set: what was taken off makes no acute angle with the way to any of its corners
    third = limit / 3
    hexagon = [
        [sign * c for c in corner] for sign in (-third, third) for corner in ((1, 1, -2), (1, -2, 1), (-2, 1, 1))
    ]
    angles = ((before - kept)[:, None] * (torch.tensor(hexagon).double() - kept[:, None])).sum(2)
    assert angles.max() <= 1e-9 * limit**2
    middle = kept[:, 1].abs()
    on_a_corner, flows = middle > third * (1 - 1e-9), largest > limit * (1 - 1e-9)
    assert 50 < (flows & on_a_corner).sum() < 250
    assert (flows & ~on_a_corner).sum() > 20
    assert (~flows).sum() > 20


def test_sand_bears_shear_in_proportion_to_pressure_and_no_tension() -> None:
    trial = strains(2, 0.05)
    stress = stress_after(DruckerPrager(), trial, SAND)
    sine = math.sin(math.radians(30.0))
    alpha = math.sqrt(2 / 3) * 2 * sine / (3 - sine)
    shear, tension, expanding = safe_norm(deviator(stress)), trace(stress), trace(trial) > 0
    assert 0.2 < expanding.double().mean() < 0.8
    assert (shear <= -alpha * tension * (1 + 1e-12) + 1e-7).all()
    assert stress[:, :, expanding].abs().max() < 1e-8
    torch.testing.assert_close(
        trace(stress)[~expanding],
        ((3 * lame_constants(per_particle(SAND, 1))[0] + 2 * lame_constants(per_particle(SAND, 1))[1]) * trace(trial))[
            ~expanding
        ],
        rtol=1e-10,
        atol=1e-6,
    )


def test_sand_in_triaxial_compression_yields_at_its_friction_angle() -> None:
    trial = 0.05 * principal(-2.0, 1.0, 1.0) - 0.01 * principal(1.0, 1.0, 1.0)
    for angle in (0.0, 18.0, 38.0):
        stress = stress_after(DruckerPrager(), trial, HOOKE | {"friction_angle": angle})
        axial, lateral = float(stress[0, 0]), float(stress[1, 1])
        assert (axial - lateral) / (axial + lateral) == pytest.approx(math.sin(math.radians(angle)), abs=1e-12)


def test_an_expansion_of_sand_returns_to_the_rotation() -> None:
    turn = rotations(3)
    expansion = strains(4, 0.2)
    expansion = expansion - identity_like(expansion) * (trace(expansion) - trace(expansion).abs() - 1e-3) / 3
    elastic = DruckerPrager()(matmul(exp_symmetric(expansion), turn), per_particle(SAND, turn.shape[2]))
    torch.testing.assert_close(elastic, turn, rtol=0, atol=1e-13)


@pytest.mark.parametrize(
    ("plasticity", "values"), [(VonMises(), PLASTICINE), (Tresca(), PLASTICINE), (DruckerPrager(), SAND)]
)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_a_deformation_inside_the_yield_surface_is_not_touched(
    plasticity: Plasticity, values: dict[str, float], dtype: torch.dtype
) -> None:
    small = strains(5, 1e-3)
    inside = matmul(exp_symmetric(small - 0.02 * identity_like(small)), rotations(6)).to(dtype)
    assert torch.equal(plasticity(inside, per_particle(values, inside.shape[2], dtype)), inside)


def test_transposed_input_is_the_same_law() -> None:
    f = deformations(14, 0.2)
    parameters = per_particle(HOOKE, f.shape[2])
    strided = transpose(transpose(f).contiguous())
    assert torch.equal(StVKHencky()(f, parameters), StVKHencky()(strided, parameters))
    torch.testing.assert_close(hencky_strain(f), hencky_strain(strided), rtol=0, atol=0)
