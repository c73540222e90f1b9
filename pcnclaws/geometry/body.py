"""Bodies for programs: particles of a shape, of the inside of a mesh, or of one's own. Particle-first."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd import forward_ad

from pcnclaws.errors import UserError
from pcnclaws.geometry.mesh_sources import Array, finite_array, surface_of
from pcnclaws.geometry.shapes import MAXIMUM_PARTICLES_PER_EDGE, PointCloud, particles, surface_particles
from pcnclaws.geometry.velocity_gradients import gradient_weights, velocity_gradients

Point: TypeAlias = Sequence[float | int]
MIDDLE = (0.5, 0.5, 0.5)


class Body:
    """A body of particles, undeformed: where they are and how much of it each one stands for.

    Made by Body.cube, Body.sphere, Body.shape, Body.mesh and Body.points. A body does not know of which material it is,
    nor how it moves.
    """

    def __init__(self, name: str, cloud: PointCloud, centre: Point | None = None) -> None:
        """name: of the scenes made of it; centre: that spins are about [m], None for the mean of the positions."""
        self.name, self.cloud = name, cloud
        middle = cloud.position.mean(0) if centre is None else np.asarray(centre, dtype=np.float64)
        self.centre = torch.from_numpy(middle)

    @classmethod
    def cube(
        cls, side: float | int = 0.5, centre: Point = MIDDLE, particles_per_edge: int = 10, lattice: str = "centres"
    ) -> "Body":
        """A cube of this side [m] about a centre [m].

        lattice  'centres': particles in the centres of equal cells; 'faces': the outermost ones on the faces
        """
        return cls.shape("cube", side, centre, particles_per_edge, lattice)

    @classmethod
    def sphere(
        cls, side: float | int = 0.5, centre: Point = MIDDLE, particles_per_edge: int = 10, lattice: str = "centres"
    ) -> "Body":
        """A sphere whose diameter is `side` [m]: the particles of the cube's lattice that lie in it."""
        return cls.shape("sphere", side, centre, particles_per_edge, lattice)

    @classmethod
    def shape(
        cls,
        name: str,
        side: float | int = 0.5,
        centre: Point = MIDDLE,
        particles_per_edge: int = 10,
        lattice: str = "centres",
    ) -> "Body":
        """A named shape: cube, sphere, torus, star, twisted_bar, hollow_box, spiky_sphere.

        side    edge of the cube, diameter of the sphere, edge of the box that another shape is defined in [m]
        raises  UserError, with the nearest known name
        """
        _require_numbers(centre, side, particles_per_edge)
        return cls(name, particles(name, centre, side, particles_per_edge, lattice), centre)

    @classmethod
    def mesh(
        cls,
        source: str | Path | tuple[Array, Array],
        *,
        spacing: float | int | None = None,
        particles_per_edge: int | None = None,
        side: float | int | None = None,
        centre: Point | None = None,
        lattice: str = "centres",
    ) -> "Body":
        """The inside of a watertight surface mesh, in metres and where it is unless `side` and `centre` say otherwise.

        source              a file that trimesh reads, or vertices (V, 3) and triangles (F, 3)
        spacing             distance of the particles [m], at most, or
        particles_per_edge  their number along the longest edge of the bounding box, 10 without either
        side                longest edge of the bounding box [m], to which the mesh is scaled
        centre              of the bounding box [m]
        raises              UserError, one line, for whatever is wrong with the mesh
        """
        surface = surface_of(source)
        name = Path(source).stem if isinstance(source, str | Path) else "mesh"
        side = surface.unit if side is None else side
        middle: Point = surface.middle.tolist() if centre is None else centre
        _require_numbers(middle, side, particles_per_edge)
        per_edge = _per_edge(spacing, particles_per_edge, side, lattice)
        return cls(name, surface_particles(surface, middle, side, per_edge, lattice), middle)

    @classmethod
    def points(cls, position: Array, volume: Array | float, density: Array | float | None = None) -> "Body":
        """Particles of one's own.

        position  [m], (particles, 3)
        volume    [m^3], (particles,), or one for all
        density   [kg/m^3], (particles,), or one for all; None: that of the settings
        raises    UserError
        """
        where = finite_array("position", position, (None, 3))
        count = len(where)
        each = {"volume": volume} if density is None else {"volume": volume, "density": density}
        arrays = {name: _positive(name, values, count) for name, values in each.items()}
        return cls("points", PointCloud(where, np.zeros_like(where), arrays["volume"], density=arrays.get("density")))

    @property
    def position(self) -> Float[Tensor, "particles 3"]:
        """[m], (particles, 3)."""
        return torch.from_numpy(self.cloud.position)

    @property
    def volume(self) -> Float[Tensor, " particles"]:
        """[m^3], (particles,)."""
        return torch.from_numpy(self.cloud.volume)

    @property
    def density(self) -> Float[Tensor, " particles"] | None:
        """[kg/m^3], (particles,), None where it is that of the settings."""
        return None if self.cloud.density is None else torch.from_numpy(self.cloud.density)

    def __len__(self) -> int:
        """Number of particles."""
        return len(self.cloud.position)

    def __repr__(self) -> str:
        return f"Body({self.name!r}, {len(self)} particles, {float(self.volume.sum()):.4g} m^3)"

    def start_motion(
        self, velocity: Float[Tensor, "3"] | Float[Tensor, "particles 3"], spin: Float[Tensor, "3"]
    ) -> tuple[Float[Tensor, "particles 3"], Float[Tensor, "particles 3 3"]]:
        """Initial velocity [m/s] of each particle and its gradient [1/s], differentiable.

        velocity  of all particles, or of each; the gradient of the latter is the least-squares fit to the neighbours
        spin      rigid rotation about the centre that is added [rad/s]
        """
        offset = self.position - self.centre
        turned = _cross(spin, offset.unbind(1))
        gradient = torch.stack(_cross(spin, torch.eye(3, dtype=torch.float64).unbind(0)), dim=0)
        own = self._gradient(velocity) if velocity.dim() == 2 else torch.zeros(len(self), 3, 3, dtype=torch.float64)
        return velocity + torch.stack(turned, dim=1), own + gradient

    def _gradient(self, velocity: Float[Tensor, "particles 3"]) -> Float[Tensor, "particles 3 3"]:
        cloud = self.cloud
        fitted = torch.from_numpy(velocity_gradients(cloud.position, velocity.detach().numpy(), cloud.volume))
        if not velocity.requires_grad and forward_ad.unpack_dual(velocity).tangent is None:
            return fitted
        # the same map as a function of torch: its value cancels, its derivatives stay
        neighbour, weight = (torch.from_numpy(one) for one in gradient_weights(cloud.position, cloud.volume))
        linear = torch.einsum("pni,pnj->pij", velocity[neighbour] - velocity[:, None], weight)
        return fitted + (linear - linear.detach())


def _cross(spin: Tensor, vector: Sequence[Tensor]) -> tuple[Tensor, Tensor, Tensor]:
    """spin x vector by components, in the order of operations of NumPy."""
    (a, b, c), (x, y, z) = spin.unbind(0), vector
    return b * z - c * y, c * x - a * z, a * y - b * x


def _require_numbers(centre: Any, side: Any, particles_per_edge: Any) -> None:
    """Refuses what is no number; its range is looked at elsewhere."""
    if not _is_number(side):
        raise UserError(f"scene.side={side} is not accepted; accepted: above 0 m")
    if isinstance(centre, str) or not isinstance(centre, Sequence) or not all(map(_is_number, centre)):
        raise UserError(f"scene.centre={centre} is not accepted; accepted: three finite numbers [m]")
    if particles_per_edge is not None and (not _is_number(particles_per_edge) or isinstance(particles_per_edge, float)):
        raise UserError(f"scene.particles_per_edge={particles_per_edge} is not accepted; accepted: a whole number")


def _is_number(value: Any) -> bool:
    return isinstance(value, float | int) and not isinstance(value, bool)


def _per_edge(spacing: float | int | None, particles_per_edge: int | None, side: float | int, lattice: str) -> int:
    """Particles along the longest edge of a mesh."""
    if spacing is None:
        return 10 if particles_per_edge is None else particles_per_edge
    if particles_per_edge is not None:
        raise UserError(f"spacing={spacing} and particles_per_edge={particles_per_edge} are two; accepted: one of them")
    if not (_is_number(spacing) and math.isfinite(spacing) and side / MAXIMUM_PARTICLES_PER_EDGE <= spacing <= side):
        raise UserError(
            f"spacing={spacing} is not accepted; accepted: {side / MAXIMUM_PARTICLES_PER_EDGE:.3g} to {side:.3g} m, "
            "the longest edge of the body"
        )
    cells = math.ceil(side / spacing * (1.0 - 1e-9))
    return max(cells + (lattice == "faces"), 2)


def _positive(name: str, values: Array | float, count: int) -> np.ndarray:
    array = finite_array(name, values, () if np.ndim(values) == 0 else (count,))  # pyright: ignore[reportArgumentType]
    if array.min() <= 0.0:
        raise UserError(f"{name} is not positive everywhere")
    return np.full(count, array) if array.ndim == 0 else array
