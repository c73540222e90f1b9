"""Laws found from measured stress: known laws come back, free sides carry no stress, derivatives are exact."""

from pathlib import Path

import numpy as np
import pytest
import torch

from pcnclaws.data.loading_path_files import read_loading_paths
from pcnclaws.data.loading_paths import LoadingPath
from pcnclaws.errors import UserError
from pcnclaws.laws.materials import material_named
from pcnclaws.laws.stretch_energy import StretchEnergyNet
from pcnclaws.training.principal_paths import principal_paths
from pcnclaws.training.stress_fit import StressProblem, fit_stress, relative_errors

FOAM = Path(__file__).parents[2] / "docs" / "measured" / "foam"


def _law() -> StretchEnergyNet:
    torch.manual_seed(0)
    return StretchEnergyNet(material_named("elasticity"), 6).double()


def _path(name: str, stretches: np.ndarray, stress: np.ndarray, sides: int = 1) -> LoadingPath:
    deformation = np.full((len(stretches), 3, 3), np.nan) * np.eye(3)
    deformation[:, ~np.eye(3, dtype=bool)] = 0.0
    measured = np.full((len(stretches), 3, 3), np.nan)
    for side in range(sides):
        deformation[:, side, side], measured[:, side, side] = stretches, stress
    return LoadingPath(name, "specimen", deformation, np.arange(3) >= sides, measured, False)


def test_a_neo_hookean_rubber_comes_back_with_its_modulus_and_predicts_what_it_was_not_trained_on() -> None:
    stretch, less = np.linspace(0.6, 2.5, 30), np.linspace(1.0, 1.6, 20)
    tension = _path("UT", stretch, 3e5 * (stretch - stretch**-2))
    biaxial = _path("ET", less, 3e5 * (less - less**-5), sides=2)
    shear = _path("PS", stretch, 3e5 * (stretch - stretch**-3))._replace(weight=0.0, free=np.arange(3) == 2)
    shear.deformation[:, 1, 1] = 1.0
    paths = principal_paths([tension, biaxial, shear], ["specimen"], True)
    problem = StressProblem(_law(), paths, ["specimen"], 0.5)
    found = fit_stress(problem, problem.start(0), 60)
    *trained, left_out = relative_errors(paths, found.predicted)
    assert max(trained) < 0.01
    assert left_out < 0.03
    assert found.specimens[0].youngs_modulus == pytest.approx(9e5, rel=0.03)


@pytest.mark.parametrize("ratio", [0.0, 0.3])
def test_derivatives_by_the_unknowns_go_through_the_free_sides(ratio: float) -> None:
    paths = read_loading_paths(sorted(FOAM.glob("foam_leap_*.csv")))
    paths = [path._replace(deformation=path.deformation[::10], stress=path.stress[::10]) for path in paths]
    paths.append(paths[0]._replace(name="cauchy", is_cauchy=True))
    problem = StressProblem(_law(), principal_paths(paths, ["specimen"], False), ["specimen"], ratio)
    start = problem.start(0) + 0.1 * torch.randn(len(problem.start(0)), generator=torch.Generator().manual_seed(1))
    at = problem.at(problem.numbers(start))
    assert float((at.stress * problem.paths.free).abs().max()) < 1e-9 * float(at.stress.abs().max())
    assert (float(at.strain[problem.paths.free].abs().max()) > 0.01) == (ratio > 0.0)
    direction = torch.randn(len(start), generator=torch.Generator().manual_seed(2)).double()
    predicted, slopes = problem.linearised(start)
    ahead, behind = (problem.predicted(start + sign * 1e-6 * direction) for sign in (1.0, -1.0))
    torch.testing.assert_close(slopes @ direction, (ahead - behind) / 2e-6, rtol=1e-5, atol=1e-7)
    torch.testing.assert_close(predicted, problem.predicted(start))


def test_the_fit_is_the_law_that_simulations_use() -> None:
    paths = read_loading_paths([FOAM / "foam_leap_UT.csv"])
    problem = StressProblem(law := _law(), principal_paths(paths, ["specimen"], False), ["specimen"], 0.0)
    found = fit_stress(problem, problem.start(0), 5)
    found.put_into(law, 0)
    stretch = torch.from_numpy(paths[0].deformation[:, 0, 0])
    ones = torch.ones_like(stretch)
    f = torch.diag_embed(torch.stack((stretch, ones, ones), 1)).permute(1, 2, 0)
    known = {"youngs_modulus": found.specimens[0].youngs_modulus * ones, "poissons_ratio": 0.0 * ones}
    stress = law.kirchhoff_stress(f, known)[0, 0] / stretch
    torch.testing.assert_close(stress, found.predicted * problem.paths.size, rtol=1e-5, atol=1.0)


def test_pressure_without_a_free_side_is_refused() -> None:
    held = _path("held", np.array([1.1]), np.array([1e5]))._replace(
        free=np.zeros(3, bool), deformation=np.diag([1.25, 0.8, 1.0])[None]
    )
    with pytest.raises(UserError, match=r"held: no side is free, which leaves the pressure"):
        principal_paths([held], ["specimen"], True)
