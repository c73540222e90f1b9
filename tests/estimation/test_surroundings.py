"""What stands around the body is found along: walls that are elsewhere, that rub, and gravity that points elsewhere."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from observed_bodies import TRUTH, observed, problem_of, solved, start, unknowns_of

from pcnclaws.data.observation import Observation
from pcnclaws.estimation.surroundings import across, gravity_of
from pcnclaws.estimation.uncertainty import ROUNDING, uncertainty

# PyTorch warns of its own use of torch.jit when it loads forward mode
pytestmark = pytest.mark.filterwarnings("ignore:`torch.jit.script` is deprecated:DeprecationWarning")
GUESS = {"youngs_modulus": 1.3e5, "poissons_ratio": 0.2, "wall_friction": 0.1}
G = (0.0, -9.8, 0.0)


def seen(**settings: Any) -> Observation:
    """A cube that hits the floor in other surroundings, with those that are taken for granted."""
    scene = start("elasticity")
    moved = observed(replace(scene, settings=replace(scene.settings, **settings)), steps=120, every=10)
    return replace(moved, settings=scene.settings)


def found(observation: Observation, sought: str, iterations: int = 8) -> dict[str, float | None]:
    """The numbers that the motion tells."""
    unknowns = unknowns_of(observation, surroundings=[sought])
    problem = problem_of(observation, unknowns)
    u, at = solved(problem, [GUESS.get(unknown.name, 0.0) for unknown in unknowns.sought], iterations)
    estimates = uncertainty(at, unknowns, u, ROUNDING, 1e-4).estimates
    return {one.label: one.value if one.identifiable else None for one in estimates}


def test_a_floor_that_is_higher_is_found_and_walls_that_nothing_meets_are_not() -> None:
    numbers = found(seen(domain=((0.0, 0.003, 0.0), (1.0, 1.003, 1.0))), "walls")
    assert numbers["walls_y"] == pytest.approx(0.003, abs=2e-5)
    assert numbers["youngs_modulus"] == pytest.approx(TRUTH["elasticity"]["youngs_modulus"], rel=2e-3)
    assert (numbers["walls_x"], numbers["walls_z"]) == (None, None)


@pytest.mark.slow
def test_the_friction_of_the_floor_is_found() -> None:
    numbers = found(seen(friction=0.3), "friction")
    assert numbers["wall_friction"] == pytest.approx(0.3, abs=2e-3)
    assert numbers["youngs_modulus"] == pytest.approx(TRUTH["elasticity"]["youngs_modulus"], rel=2e-3)


@pytest.mark.slow
def test_the_direction_of_gravity_is_found() -> None:
    unknowns = unknowns_of(seen(), surroundings=["gravity"])
    values = np.array([2.0 if unknown.name == "tilt_1" else -1.0 for unknown in unknowns.sought])
    turned = gravity_of(unknowns, values, G)
    numbers = found(seen(gravity=tuple(turned.tolist())), "gravity")
    assert numbers["tilt_1"] == pytest.approx(2.0, abs=0.02)
    assert numbers["tilt_2"] == pytest.approx(-1.0, abs=0.02)


def test_tilts_turn_gravity_about_the_axes_across_it_and_keep_its_size() -> None:
    unknowns = unknowns_of(seen(), surroundings=["gravity"])
    turned = gravity_of(unknowns, np.array([0.0, 0.0, 90.0, 0.0]), G)
    np.testing.assert_allclose(turned, (0.0, 0.0, -9.8), atol=1e-12)  # about x, from -y to -z
    np.testing.assert_allclose(np.linalg.norm(gravity_of(unknowns, np.array([0.0, 0.0, 3.0, 4.0]), G)), 9.8)
    assert across((0.0, 0.0, -9.8)) == (0, 1)


def test_what_does_not_move_is_where_it_was() -> None:
    observation = seen()
    plain, unknowns = problem_of(observation), unknowns_of(observation, surroundings=["walls", "gravity"])
    truth = [*TRUTH["elasticity"].values()]
    motion = problem_of(observation, unknowns).motion(unknowns.coordinates([*truth, *[0.0] * 5]))
    np.testing.assert_array_equal(motion, plain.motion(plain.unknowns.coordinates(truth)))
