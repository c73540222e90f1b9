"""Bodies of a program: those of the commands, of one's own points, and of meshes in metres."""

import numpy as np
import pytest
import torch

import pcnclaws as pc
from pcnclaws.geometry.shapes import mesh_particles, particles
from pcnclaws.geometry.velocity_gradients import gradient_weights, velocity_gradients

CORNERS = np.array([[x, y, z] for x in (0.3, 0.6) for y in (0.2, 0.4) for z in (0.4, 0.6)])
FACES = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ]
)


def test_shapes_are_those_of_the_commands():
    for body, name in (
        (pc.Body.cube(0.3, (0.5, 0.4, 0.5), 5), "cube"),
        (pc.Body.sphere(0.3, (0.5, 0.4, 0.5), 5), "sphere"),
        (pc.Body.shape("torus", 0.3, (0.5, 0.4, 0.5), 12), "torus"),
    ):
        cloud = particles(name, (0.5, 0.4, 0.5), 0.3, 12 if name == "torus" else 5, "centres")
        np.testing.assert_array_equal(body.position.numpy(), cloud.position)
        np.testing.assert_array_equal(body.volume.numpy(), cloud.volume)
        assert (len(body), body.name, body.centre.tolist()) == (len(cloud.position), name, [0.5, 0.4, 0.5])


def test_a_mesh_is_in_metres_and_where_it_is():
    body = pc.Body.mesh((CORNERS, torch.from_numpy(FACES)), spacing=0.05)
    assert len(body) == 6 * 4 * 4
    assert float(body.volume.sum()) == pytest.approx(0.012)
    assert body.position.min(0).values.tolist() == pytest.approx([0.325, 0.225, 0.425])
    assert body.centre.tolist() == pytest.approx([0.45, 0.3, 0.5])
    assert len(pc.Body.mesh((CORNERS, FACES), spacing=0.0499)) > len(body)


def test_a_mesh_file_that_is_scaled_is_that_of_the_command(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    trimesh.creation.icosphere(2, 3.0).export(tmp_path / "ball.stl")
    body = pc.Body.mesh(tmp_path / "ball.stl", particles_per_edge=6, side=0.4, centre=(0.5, 0.5, 0.5))
    cloud = mesh_particles(tmp_path / "ball.stl", (0.5, 0.5, 0.5), 0.4, 6, "centres")
    np.testing.assert_array_equal(body.position.numpy(), cloud.position)
    assert body.name == "ball"


def test_points_of_ones_own():
    body = pc.Body.points(np.random.default_rng(0).random((5, 3)), 1e-3, torch.full((5,), 900.0))
    assert body.volume.tolist() == [1e-3] * 5
    assert body.density is not None
    assert body.density.tolist() == [900.0] * 5
    assert body.centre.tolist() == pytest.approx(body.position.mean(0).tolist())


WRONG = {
    "shape": (lambda: pc.Body.shape("tours"), "did you mean 'torus'"),
    "side": (lambda: pc.Body.cube(side=-0.1), "scene.side=-0.1"),
    "centre": (lambda: pc.Body.cube(centre=(0.5, float("nan"), 0.5)), "scene.centre"),
    "coarse": (lambda: pc.Body.cube(particles_per_edge=1), "scene.particles_per_edge=1"),
    "lattice": (lambda: pc.Body.cube(lattice="centers"), "did you mean 'centres'"),
    "missing file": (lambda: pc.Body.mesh("missing.stl"), "scene.mesh=missing.stl: no such file"),
    "two spacings": (lambda: pc.Body.mesh((CORNERS, FACES), spacing=0.1, particles_per_edge=3), "one of them"),
    "wide spacing": (lambda: pc.Body.mesh((CORNERS, FACES), spacing=0.5), "accepted: 0.0015 to 0.3 m"),
    "open mesh": (lambda: pc.Body.mesh((CORNERS, FACES[1:])), "scene.mesh=(vertices, faces) is not watertight"),
    "faces": (lambda: pc.Body.mesh((CORNERS, FACES + 1)), "accepted: 0 to 7"),
    "flat points": (lambda: pc.Body.points(np.zeros((5, 2)), 1.0), "position has the shape (5, 2)"),
    "no point": (lambda: pc.Body.points(np.zeros((0, 3)), 1.0), "accepted: numbers (N, 3)"),
    "volumes": (lambda: pc.Body.points(np.zeros((5, 3)), np.ones(4)), "volume has the shape (4,)"),
    "no volume": (lambda: pc.Body.points(np.zeros((5, 3)), 0.0), "volume is not positive everywhere"),
    "not finite": (lambda: pc.Body.points(np.full((5, 3), np.nan), 1.0), "position holds numbers that are not finite"),
    "gradients": (lambda: pc.Body.points(torch.zeros(5, 3, requires_grad=True), 1.0), "position.detach()"),
}


@pytest.mark.parametrize("case", list(WRONG))
def test_wrong_bodies_are_refused_in_one_line(case):
    make, message = WRONG[case]
    with pytest.raises(pc.UserError) as caught:
        make()
    assert message in str(caught.value)


def test_the_weights_of_the_fit_are_its_linear_map():
    random = np.random.default_rng(1)
    position, velocity, volume = random.random((40, 3)), random.standard_normal((40, 3)), np.full(40, 1 / 40)
    neighbour, weight = gradient_weights(position, volume)
    change = velocity[neighbour] - velocity[:, None]
    fitted = np.einsum("pni,pnj->pij", change, weight)
    np.testing.assert_allclose(fitted, velocity_gradients(position, velocity, volume), rtol=0, atol=1e-10)
    assert np.abs(fitted).max() > 0.1
