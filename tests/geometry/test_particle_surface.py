"""The surface of a body of particles, and the part of it that a camera sees."""

import numpy as np
import pytest

from pcnclaws.errors import UserError
from pcnclaws.geometry.particle_surface import ParticleSurface, face_normals, particle_surface
from pcnclaws.geometry.shapes import PointCloud, particles
from pcnclaws.geometry.surface_views import seen_points
from pcnclaws.simulation.particle_spacing import particle_spacing


def surface_of(body: PointCloud) -> tuple[ParticleSurface, np.ndarray]:
    """The surface, and its vertices moved out."""
    surface = particle_surface(body.position, body.volume, particle_spacing(body.position, body.volume))
    return surface, body.position[surface.particle] + surface.offset * surface.outward


@pytest.mark.parametrize("lattice", ["faces", "centres"])
def test_that_of_a_cube_is_its_six_faces(lattice: str) -> None:
    surface, vertices = surface_of(particles("cube", side=0.4, particles_per_edge=5, lattice=lattice))
    corners = vertices[surface.faces]
    normal = face_normals(corners)
    assert 0.5 * np.linalg.norm(normal, axis=1).sum() == pytest.approx(6 * 0.4**2, rel=1e-5)
    assert surface.offset == pytest.approx(0.0 if lattice == "faces" else 0.04, abs=1e-6)
    np.testing.assert_allclose(np.abs(vertices - 0.5).max(1), 0.2, atol=1e-6)
    assert (np.sum((corners.mean(1) - 0.5) * normal, axis=1) > 0.0).all()  # they face outwards


@pytest.mark.parametrize(("shape", "per_edge"), [("sphere", 8), ("torus", 16), ("hollow_box", 12)])
def test_it_is_closed_and_holds_the_volume_of_the_particles(shape: str, per_edge: int) -> None:
    body = particles(shape, particles_per_edge=per_edge, lattice="centres")
    surface, vertices = surface_of(body)
    edges = np.sort(surface.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    counts = np.unique(edges, axis=0, return_counts=True)[1]
    assert (counts % 2 == 0).all()
    corners = vertices[surface.faces]
    assert np.sum(corners[:, 0] * face_normals(corners)) / 6.0 == pytest.approx(body.volume.sum(), rel=1e-4)


def test_two_bodies_have_two_surfaces() -> None:
    one = particles("cube", side=0.2, particles_per_edge=4)
    position = np.concatenate((one.position, one.position + np.array([0.35, 0.0, 0.0])))
    surface = particle_surface(position, np.tile(one.volume, 2), 0.2 / 3)
    sides = position[surface.particle[surface.faces], 0] > 0.62
    assert (sides.all(1) | ~sides.any(1)).all()


def test_particles_of_a_plane_or_far_apart_are_refused() -> None:
    flat = particles("cube", particles_per_edge=4).position
    flat[:, 1] = 0.5
    with pytest.raises(UserError, match="its 64 particles have no inside"):
        particle_surface(flat, np.ones(64), 0.1)
    with pytest.raises(UserError, match="too far apart to have a surface"):
        particle_surface(particles("cube", particles_per_edge=4).position, np.ones(64), 0.01)


def test_a_camera_sees_the_three_faces_that_are_turned_to_it() -> None:
    surface, vertices = surface_of(particles("cube", side=0.4, particles_per_edge=5))
    seen = seen_points(vertices, surface.faces, 600, np.array([1.0, 2.0, 0.5]), np.random.default_rng(0))
    assert seen.shape == (600, 3)
    at = np.isclose(seen, 0.7, atol=1e-9)
    assert at.any(1).all()
    np.testing.assert_allclose(at.mean(0), 1.0 / 3.0, atol=0.08)
    around = seen_points(vertices, surface.faces, 600, None, np.random.default_rng(0))
    np.testing.assert_allclose(np.isclose(around, 0.3, atol=1e-9).mean(0), 1.0 / 6.0, atol=0.06)


def test_what_another_body_hides_is_not_seen() -> None:
    one = particles("cube", side=0.2, particles_per_edge=4)
    position = np.concatenate((one.position, one.position + np.array([0.4, 0.0, 0.0])))
    surface = particle_surface(position, np.tile(one.volume, 2), 0.2 / 3)
    seen = seen_points(
        position[surface.particle], surface.faces, 200, np.array([1.0, 0.0, 0.0]), np.random.default_rng(0)
    )
    np.testing.assert_allclose(seen[:, 0], 1.0, atol=1e-9)
