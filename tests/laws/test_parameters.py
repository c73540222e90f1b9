"""What physical parameters, materials and settings are accepted, and the moduli that follow."""

import math
from typing import Any

import pytest
from bodies import per_particle

from pcnclaws.errors import UserError
from pcnclaws.laws.materials import MATERIALS, material_named
from pcnclaws.laws.moduli import lame_constants
from pcnclaws.laws.parameters import validate_parameters
from pcnclaws.mpm.settings import SimulationSettings

HOOKE = {"youngs_modulus": 3e5, "poissons_ratio": 0.3}
SAND = HOOKE | {"friction_angle": 30.0}


def test_lame_constants_of_a_known_material() -> None:
    lam, mu = lame_constants(per_particle({"youngs_modulus": 2.6e5, "poissons_ratio": 0.3}, 1))
    assert float(mu) == pytest.approx(1e5)
    assert float(lam) == pytest.approx(1.5e5)


@pytest.mark.parametrize(
    ("values", "named"),
    [
        (SAND | {"poissons_ratio": 0.5}, "parameters.poissons_ratio=0.5"),
        (SAND | {"poissons_ratio": -1.0}, "parameters.poissons_ratio=-1.0"),
        (SAND | {"youngs_modulus": 0.0}, "parameters.youngs_modulus=0.0"),
        (SAND | {"youngs_modulus": math.nan}, "parameters.youngs_modulus=nan"),
        (SAND | {"youngs_modulus": math.inf}, "parameters.youngs_modulus=inf"),
        (SAND | {"friction_angle": 90.0}, "parameters.friction_angle=90.0"),
        (SAND | {"friction_angle": -1.0}, "parameters.friction_angle=-1.0"),
        (HOOKE, "parameters.friction_angle is missing"),
        (SAND | {"frictionangle": 3.0}, "did you mean 'friction_angle'"),
    ],
)
def test_unphysical_parameters_are_refused_by_name(values: dict[str, float], named: str) -> None:
    with pytest.raises(UserError, match=named):
        validate_parameters(values, MATERIALS["sand"].parameter_names)


def test_the_ends_of_the_accepted_ranges_are_accepted() -> None:
    validate_parameters(SAND | {"friction_angle": 0.0, "poissons_ratio": -0.99}, MATERIALS["sand"].parameter_names)
    for material in MATERIALS.values():
        validate_parameters(material.defaults, material.parameter_names)


def test_an_unknown_material_is_answered_with_the_nearest_one() -> None:
    with pytest.raises(UserError, match="did you mean 'plasticine'"):
        material_named("plastecine")


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({"time_step": 0.0}, "simulation.time_step"),
        ({"time_step": float("nan")}, "simulation.time_step"),
        ({"grid_spacing": 0.0}, "simulation.grid_spacing"),
        ({"grid_spacing": 1e-7}, "simulation.grid_spacing"),
        ({"wall_distance": -0.1}, "simulation.wall_distance"),
        ({"wall_distance": 0.5}, "simulation.wall_distance"),
        ({"wall_distance": float("nan")}, "simulation.wall_distance"),
        ({"gravity": (0.0, float("inf"), 0.0)}, "simulation.gravity"),
        ({"density": -1.0}, "simulation.density"),
    ],
)
def test_nonsense_settings_are_refused_by_name(changed: dict[str, Any], named: str) -> None:
    with pytest.raises(UserError, match=named):
        SimulationSettings(**changed)


def test_an_unknown_boundary_is_answered_with_the_nearest_one() -> None:
    with pytest.raises(UserError, match="did you mean 'sticky'"):
        SimulationSettings(boundary="stik")
