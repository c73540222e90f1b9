"""Walls that hold whatever is pressed against them, and what is said of those that do not."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from recorded_scenes import ELASTIC, SAND

from pcnclaws.commands.composition import compose_config
from pcnclaws.commands.configuration import settings_from
from pcnclaws.errors import ParticleEscaped, SimulationDiverged, UserError
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.materials import MATERIALS, material_named
from pcnclaws.mpm.contact import VERSION_1_STICK
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.mpm.state import ParticleState
from pcnclaws.simulation.physical_states import why_failing
from pcnclaws.simulation.placement import require_inside
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.scenes import SceneStart
from pcnclaws.simulation.time_step import Stability

PARAMETERS = {
    "elasticity": ELASTIC,
    "sand": SAND,
    "plasticine": {"youngs_modulus": 3e5, "poissons_ratio": 0.3, "yield_stress": 5e3},
}


def lowest_of_what_is_pressed_into_a_corner(material: str, settings: SimulationSettings) -> float:
    """The smallest coordinate [m] of a cube that begins in the corner of the wall layers and is pressed into it."""
    edge = 0.05 * np.arange(5)
    position = settings.wall_distance + np.stack(np.meshgrid(edge, edge, edge, indexing="ij"), axis=-1).reshape(-1, 3)
    velocity = np.tile([-2.0, -4.0, -1.5], (125, 1))
    start = SceneStart("cube", material, settings, PARAMETERS[material], position, velocity, np.full(125, 0.05**3))
    record = simulate_records([start], analytic_laws(MATERIALS[material]), FramePlan(400, 10))[0]
    return float(record.position.min())


@pytest.mark.parametrize("boundary", ["separate", VERSION_1_STICK])
@pytest.mark.parametrize("material", list(PARAMETERS))
def test_a_wall_layer_of_one_cell_holds(material: str, boundary: str) -> None:
    settings = SimulationSettings(5e-4, 1 / 10, 0.1, (-15.0, -40.0, -10.0), boundary)
    settings.require_walls_that_hold()
    depth = 0.1 - lowest_of_what_is_pressed_into_a_corner(material, settings)
    assert depth < 0.5 * settings.grid_spacing


def test_what_is_pressed_through_a_thinner_one_is_told_so() -> None:
    settings = SimulationSettings(5e-4, 1 / 10, 0.0, (-15.0, -40.0, -10.0))
    with pytest.raises(ParticleEscaped, match=r"left the domain") as escape:
        lowest_of_what_is_pressed_into_a_corner("sand", settings)
    advice = Stability(settings, SAND, 5.0, "sand").advice(escape.value)
    assert "wall_distance=0 " in advice
    assert "0.1 m" in advice
    assert "time_step" not in advice


@pytest.mark.parametrize("distance", ["0", "0.05"])
def test_a_thinner_one_is_refused_with_the_thinnest_that_holds(distance: str) -> None:
    options = ["simulation.grid_nodes=10", f"simulation.wall_distance={distance}"]
    with pytest.raises(UserError, match=rf"{options[1]} .*accepted: 0\.1, "):
        settings_from(compose_config("simulate", options).simulation, material_named("sand"))


@pytest.mark.parametrize("nodes", [7, 12, 30, 49, 256])
def test_the_thinnest_one_that_is_named_is_accepted(nodes: int) -> None:
    with pytest.raises(UserError) as refusal:
        SimulationSettings(grid_spacing=1 / nodes, wall_distance=0.0).require_walls_that_hold()
    named = float(str(refusal.value).partition("accepted: ")[2].partition(",")[0])
    SimulationSettings(grid_spacing=1 / nodes, wall_distance=named).require_walls_that_hold()


def test_other_divergences_speak_of_the_time_step() -> None:
    for error, distance in ((SimulationDiverged("its state is not finite"), 0.0), (ParticleEscaped("it left"), 0.1)):
        advice = Stability(SimulationSettings(wall_distance=distance), SAND, 1.0, "sand").advice(error)
        assert advice.startswith("time_step=0.0005, stable: at most")


@pytest.mark.parametrize("stiffness", [1e4, 3.7e5, 2.9e6])
def test_the_longest_time_step_that_is_named_is_accepted(stiffness: float) -> None:
    long = Stability(SimulationSettings(time_step=0.1), SAND | {"youngs_modulus": stiffness}, 2.0, "sand")
    named = float(long.limit.split()[2])
    assert named == long.longest_time_step
    replace(long, settings=SimulationSettings(time_step=named)).check()


@pytest.mark.parametrize("coordinate", [0.099998, 0.0999989, 0.9000011])
def test_a_place_in_the_wall_layer_is_printed_so_that_it_is_seen_to_be_there(coordinate: float) -> None:
    position = np.full((3, 3), 0.5)
    position[1, 0] = coordinate
    with pytest.raises(UserError) as refusal:
        require_inside(position, SimulationSettings(), "scene")
    assert f"({coordinate}, 0.5, 0.5) m is inside the wall layer" in str(refusal.value)
    assert str(refusal.value).endswith("from 0.1 to 0.9 m")


def test_a_place_outside_the_domain_is_printed_so_that_it_is_seen_to_be_there() -> None:
    position = torch.tensor([[0.5], [1.0 + 2e-6], [0.5]], dtype=torch.float64)
    state = ParticleState.at_rest_shape(position, torch.zeros_like(position))
    assert why_failing(state, 0).endswith("at (0.5, 1.000002, 0.5)")
