"""Weights of the stencils, the numbering of nodes, and the walls."""

import pytest
import torch
from bodies import seeded, uniform
from torch import Tensor

from pcnclaws.mpm.boundaries import apply_walls, wall_nodes
from pcnclaws.mpm.contact import VERSION_1_STICK
from pcnclaws.mpm.grid import grid_of
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.mpm.shape_functions import Stencil, quadratic_stencil


def difficult_positions(nodes: int) -> Tensor:
    """Random positions, and ones at nodes, cell edges and sides of the domain and a rounding away from them."""
    generator = seeded(0)
    special = torch.arange(0, 2 * nodes + 1, dtype=torch.float64) / (2 * nodes)
    near = torch.cat((special, special + 1e-15, special - 1e-15, special + 1e-9, special - 1e-9)).clamp(0.0, 1.0)
    shuffled = torch.stack([near[torch.randperm(len(near), generator=generator)] for _ in range(3)])
    return torch.cat((shuffled, uniform(generator, 3, 500, low=0.0, high=1.0)), dim=1)


def stencil_at(position: Tensor, nodes: int) -> tuple[Stencil, Tensor]:
    """The stencil of one scene and the coordinates of its nodes, (3, 27, particles)."""
    grid = grid_of(SimulationSettings(grid_spacing=1 / nodes))
    scene = torch.zeros(position.shape[1], dtype=torch.int64)
    stencil = quadratic_stencil(position, scene, grid, grid.stencil_offsets())
    coordinates = grid.axis(0)
    node = stencil.node
    edge = grid.edges[0]
    where = (node // edge**2, node // edge % edge, node % edge)
    return stencil, torch.stack([coordinates[index] for index in where])


@pytest.mark.parametrize("nodes", [4, 20, 32])
def test_weights_sum_to_one_and_are_never_negative(nodes: int) -> None:
    stencil, _ = stencil_at(difficult_positions(nodes), nodes)
    assert stencil.weight.min() >= 0.0
    torch.testing.assert_close(stencil.weight.sum(0), torch.ones(stencil.weight.shape[1]).double(), rtol=0, atol=1e-15)


@pytest.mark.parametrize("nodes", [4, 20, 32])
def test_weights_reproduce_linear_fields(nodes: int) -> None:
    position = difficult_positions(nodes)
    stencil, coordinates = stencil_at(position, nodes)
    torch.testing.assert_close((stencil.weight * coordinates).sum(1), position, rtol=0, atol=1e-15)


def test_second_moment_of_the_weights_is_a_quarter_of_the_spacing_squared() -> None:
    position = difficult_positions(20)
    stencil, coordinates = stencil_at(position, 20)
    offset = coordinates - position[:, None]
    moment = torch.einsum("np,inp,jnp->ijp", stencil.weight, offset, offset)
    expected = (0.25 * 0.05**2) * torch.eye(3).double()[:, :, None].expand_as(moment)
    torch.testing.assert_close(moment, expected, rtol=0, atol=1e-17)


def test_weights_reproduce_linear_fields_in_single_precision() -> None:
    position = difficult_positions(20)
    stencil, coordinates = stencil_at(position.float(), 20)
    torch.testing.assert_close((stencil.weight * coordinates).sum(1), position, rtol=0, atol=2e-7)


def test_every_position_of_the_domain_has_all_its_nodes_inside_the_grid_of_its_scene() -> None:
    grid = grid_of(SimulationSettings())
    corners = torch.cartesian_prod(*[torch.tensor([0.0, 1.0]).double()] * 3).T
    scene = torch.arange(8)
    node = quadratic_stencil(corners, scene, grid, grid.stencil_offsets()).node
    assert ((node >= scene * grid.size) & (node < (scene + 1) * grid.size)).all()


def test_a_particle_outside_the_domain_touches_no_memory_of_others() -> None:
    grid = grid_of(SimulationSettings())
    lost = torch.tensor([[-50.0, 3.0, float("nan"), float("inf")]] * 3).double()
    node = quadratic_stencil(lost, torch.zeros(4, dtype=torch.int64), grid, grid.stencil_offsets()).node
    assert ((node >= 0) & (node < grid.size)).all()


@pytest.mark.parametrize(
    ("nodes", "wall_distance", "layers"),
    [(20, 0.1, 2), (20, 0.15, 3), (20, 0.149, 2), (20, 0.0, 0), (32, 0.1, 3), (10, 0.3, 3), (100, 0.29, 29)],
)
def test_walls_act_on_the_nodes_at_most_their_distance_from_a_side(
    nodes: int, wall_distance: float, layers: int
) -> None:
    settings = SimulationSettings(grid_spacing=1 / nodes, wall_distance=wall_distance)
    grid = grid_of(settings)
    walls = wall_nodes(grid, settings).unflatten(2, grid.edges)
    low, high = walls[0, 1, 5], walls[1, 1, 5]  # the walls of the y axis, seen in a plane
    index = torch.arange(grid.edges[1]) - 1  # number of the node from the low side
    assert torch.equal(low, (index <= layers)[:, None].expand_as(low))
    assert torch.equal(high, (index >= nodes - layers)[:, None].expand_as(high))


def velocity_after(boundary: str, at: tuple[int, int, int], velocity: tuple[float, float, float]) -> list[float]:
    """What the walls of a 20-node box leave of the velocity at a node."""
    grid = grid_of(SimulationSettings())
    field = torch.zeros(3, 1, *grid.edges)
    where = (slice(None), 0, at[0] + 1, at[1] + 1, at[2] + 1)
    field[where] = torch.tensor(velocity)
    walls = wall_nodes(grid, SimulationSettings())
    return apply_walls(field.flatten(2), walls, boundary).unflatten(2, grid.edges)[where].tolist()


def test_separate_removes_only_what_points_into_the_wall() -> None:
    assert velocity_after("separate", (10, 2, 10), (1.0, -2.0, 3.0)) == [1.0, 0.0, 3.0]
    assert velocity_after("separate", (10, 18, 10), (1.0, 2.0, 3.0)) == [1.0, 0.0, 3.0]
    assert velocity_after("separate", (1, 0, 20), (-1.0, -2.0, 3.0)) == [0.0, 0.0, 0.0]
    assert velocity_after("separate", (1, 0, 20), (-1.0, -2.0, -3.0)) == [0.0, 0.0, -3.0]


def test_stick_of_version_1_removes_all_of_a_velocity_that_points_into_a_wall() -> None:
    assert velocity_after(VERSION_1_STICK, (10, 2, 10), (1.0, -2.0, 3.0)) == [0.0, 0.0, 0.0]
    assert velocity_after(VERSION_1_STICK, (1, 2, 10), (1.0, -2.0, 3.0)) == [0.0, 0.0, 0.0]


def test_slip_removes_the_normal_component_both_ways_and_sticky_all() -> None:
    for up in (-2.0, 2.0):
        assert velocity_after("slip", (10, 2, 10), (1.0, up, 3.0)) == [1.0, 0.0, 3.0]
        assert velocity_after("sticky", (10, 2, 10), (1.0, up, 3.0)) == [0.0, 0.0, 0.0]
    assert velocity_after("sticky", (10, 3, 10), (1.0, -2.0, 3.0)) == [1.0, -2.0, 3.0]


@pytest.mark.parametrize("boundary", ["separate", VERSION_1_STICK])
def test_walls_let_go_freely(boundary: str) -> None:
    assert velocity_after(boundary, (10, 2, 10), (1.0, 2.0, 3.0)) == [1.0, 2.0, 3.0]
    assert velocity_after(boundary, (2, 2, 18), (1.0, 2.0, -3.0)) == [1.0, 2.0, -3.0]
    assert velocity_after(boundary, (10, 3, 10), (1.0, -2.0, 3.0)) == [1.0, -2.0, 3.0]
