"""Colliders from surface meshes: distances, contact, derivatives, files, and what is refused."""

from pathlib import Path

import h5py
import numpy as np
import pytest
import torch
import trimesh

import pcnclaws as pc
from pcnclaws.data.hdf5 import read_scenes
from pcnclaws.errors import UserError
from pcnclaws.mpm.colliders import Collider
from pcnclaws.simulate import simulate

pytestmark = pytest.mark.filterwarnings("ignore:`torch.jit.script` is deprecated:DeprecationWarning")

# off the nodes of the simulation, so that rounding decides of none whether it is inside
LOW, HIGH, CENTRE, RADIUS = (0.303, 0.197, 0.407), (0.703, 0.597, 0.807), (0.503, 0.397, 0.607), 0.2
Triangles = tuple[np.ndarray, np.ndarray]


def triangles(mesh: trimesh.Trimesh, centre: tuple[float, ...] = CENTRE) -> Triangles:
    mesh.apply_translation(centre)
    return np.array(mesh.vertices), np.array(mesh.faces)


def ball(subdivisions: int = 3) -> Triangles:
    return triangles(trimesh.creation.icosphere(subdivisions, RADIUS))


def brick() -> Triangles:
    return triangles(trimesh.creation.box(np.subtract(HIGH, LOW)))


def test_the_distance_of_a_meshed_sphere_is_that_of_the_sphere() -> None:
    spacing = 2 * RADIUS / 32
    points = torch.rand(3, 4000, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    true, towards, _ = Collider.sphere(CENTRE, RADIUS).distance(points, 0.0)
    found, normal, _ = Collider.mesh(ball(), spacing=spacing).distance(points, 0.0)
    near = true.abs() < spacing
    assert int(near.sum()) > 20
    assert float((found - true)[near].abs().max()) < 2e-3
    assert float((normal - towards).norm(dim=0)[near].max()) < 0.15
    assert float((found - true)[true < -spacing].abs().max()) < 5e-3
    assert float((found - true).max()) < 5e-3  # further away it is a lower bound
    assert bool((found[true > spacing] > 0.5 * spacing).all())


def test_the_distance_of_a_meshed_box_is_that_of_the_box_near_its_faces() -> None:
    across = torch.tensor([[0.5, 0.4, z] for z in (0.395, 0.407, 0.4137, 0.44)], dtype=torch.float64).T
    found, normal, _ = Collider.mesh(brick()).distance(across, 0.0)
    torch.testing.assert_close(found, 0.407 - across[2], rtol=0, atol=1e-7)
    torch.testing.assert_close(normal, torch.tensor([[0.0, 0.0, -1.0]] * 4).double().T, rtol=0, atol=1e-6)


@pytest.mark.parametrize("shape", ["sphere", "box"])
def test_a_mesh_acts_as_the_shape_that_it_describes(shape: str) -> None:
    motion = {"friction": 0.3, "velocity": (0.1, 1.0, 0.0), "spin": (0.0, 0.5, 1.0)}
    true = Collider.sphere(CENTRE, RADIUS, **motion) if shape == "sphere" else Collider.box(LOW, HIGH, **motion)
    meshed = Collider.mesh(ball() if shape == "sphere" else brick(), spacing=0.0125, **motion)
    body = pc.Body.cube(side=0.2, centre=(0.5, 0.72, 0.6), particles_per_edge=5)
    law, settings = pc.analytic_law("elasticity"), pc.Settings(domain=None)
    scene = pc.Scene(body, law, velocity=(0, -1, 0), settings=settings)
    first, second = (scene.with_(colliders=[one]).simulate(80, 80, dtype=torch.float64) for one in (true, meshed))
    given = first.impulses[-1, 0]
    assert float(given.norm()) > 5.0
    assert float((second.impulses[-1, 0] - given).norm() / given.norm()) < 0.02
    # its triangles lie up to half a millimetre inside of the sphere, and its normals turn from one to the next
    assert float((second.position - first.position).norm(dim=2).max()) < 0.01 * RADIUS


def test_derivatives_by_friction_and_velocity_of_a_mesh_are_those_of_finite_differences() -> None:
    body = pc.Body.cube(side=0.2, centre=(0.5, 0.7, 0.6), particles_per_edge=4)
    scene = pc.Scene(body, pc.analytic_law("elasticity"), velocity=(1, -1, 0.5), settings=pc.Settings(domain=None))
    surface = Collider.mesh(ball(2), spacing=0.03).shape

    def end(friction: torch.Tensor, push: torch.Tensor) -> torch.Tensor:
        found = scene.rollout(15, 15, colliders=[Collider(surface, friction=friction, velocity=push)])
        return found[-1].mean(0)

    mu = torch.tensor(0.2, dtype=torch.float64, requires_grad=True)
    push = torch.tensor([0.1, 0.3, 0.0], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(end, (mu, push), eps=1e-6, atol=1e-8, rtol=1e-5)
    assert all(slope.abs().max() > 1e-5 for slope in torch.autograd.grad(end(mu, push).sum(), (mu, push)))


def test_a_command_takes_a_mesh_and_its_file_carries_the_distances(in_process, tmp_path: Path) -> None:
    trimesh.creation.icosphere(2, 1.0).export(tmp_path / "ball.stl")
    collider = "{shape: mesh, path: ball.stl, side: 0.3, centre: [0.5, 0.1, 0.5], spacing: 0.03, friction: 0.2}"
    scene = [f"scene.colliders=[{collider}]", "scene.side=0.2", "scene.centre=[0.5,0.36,0.5]"]
    few = ["scene.particles_per_edge=4", "simulation.steps=20", "law=analytic", "output=x.h5"]
    outcome = in_process(simulate, "simulate", *scene, *few)
    assert outcome.status == 0, outcome.err
    (tmp_path / "ball.stl").rename(tmp_path / "gone.stl")
    (record,) = read_scenes(tmp_path / "x.h5")
    (read,) = record.settings.colliders
    made = Collider.mesh(tmp_path / "gone.stl", side=0.3, centre=(0.5, 0.1, 0.5), spacing=0.03, friction=0.2)
    assert read == made
    assert read != Collider.mesh(tmp_path / "gone.stl", side=0.31, centre=(0.5, 0.1, 0.5), spacing=0.03, friction=0.2)
    with h5py.File(tmp_path / "x.h5", "r+") as file:
        stored = file[f"scenes/{record.name}/colliders/0"]
        stored.attrs["shape"], stored.attrs["path"] = "mesh", "gone.stl"
    with pytest.raises(UserError, match="colliders/0.shape='mesh' is not known"):
        read_scenes(tmp_path / "x.h5")


OPEN = (np.eye(4, 3), np.array([[0, 1, 3], [1, 2, 3], [2, 0, 3]]))


@pytest.mark.parametrize(
    ("source", "options", "fault"),
    [
        ("missing.stl", {}, "path=missing.stl: no such file"),
        (OPEN, {}, "is not watertight"),
        ((OPEN[0] * (1, 1, 0), np.array([[0, 1, 3], [1, 0, 3], [1, 2, 3], [2, 1, 3]])), {}, "path=(vertices, faces)"),
        (triangles(trimesh.creation.box((1.0, 1.0, 1e-9))), {}, "is flat, or too thin"),
        (brick(), {"spacing": 1.0}, "spacing=1.0 is out of range; accepted: "),
        (brick(), {"side": -1.0}, "side=-1.0 is out of range"),
        (brick(), {"fricton": 0.3}, "did you mean 'friction'"),
    ],
)
def test_faulty_meshes_are_refused_in_one_line(source, options: dict, fault: str) -> None:
    with pytest.raises(UserError, match="^collider mesh|^collider sampled") as refused:
        Collider.mesh(source, **options)
    assert fault in str(refused.value)
    assert "\n" not in str(refused.value)
    with pytest.raises(UserError, match=r"^scene.colliders\[0\]"):
        Collider.from_options({"shape": "mesh", "path": source, **options}, "scene.colliders[0]", opens_files=True)
