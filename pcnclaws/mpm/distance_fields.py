"""Distance fields: shapes given by samples on a grid, by a surface mesh, or by a function."""

import hashlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from pcnclaws.errors import UserError
from pcnclaws.mpm.interpolation import trilinear
from pcnclaws.mpm.numbers import Number, Numbers, Real, as_number, as_tensor, as_vector, plain, scalars
from pcnclaws.mpm.shape import Distances, Points, Shape, unit

# Cells of the grid along the longest edge of a mesh.
MESH_CELLS, FEWEST_MESH_CELLS, MOST_MESH_CELLS = 64, 4, 256


@dataclass(frozen=True, eq=False)
class Sampled(Shape):
    """What a surface encloses: signed distances [m] of the nodes of a grid, (x, y, z), linear between them.

    low      the first node [m]
    spacing  of the nodes [m]

    Outside of the grid the distance is a lower bound: the root of the squares of the distance to the grid and of that
    of the surface from there.
    """

    distances: np.ndarray
    low: Numbers
    spacing: Number
    word = "sampled"
    lengths = ("spacing",)

    def __post_init__(self) -> None:
        distances = np.array(self.distances, dtype=np.float32)
        if distances.ndim != 3 or min(distances.shape) < 2 or not np.isfinite(distances).all():
            raise UserError(f"collider sampled: distances {distances.shape} are not finite numbers (x, y, z), from 2")
        object.__setattr__(self, "low", tuple(scalars(as_vector("collider sampled", "low", self.low))))
        object.__setattr__(self, "spacing", plain(as_number("collider sampled", "spacing", self.spacing)))
        object.__setattr__(self, "distances", distances)
        if not plain(self.spacing) > 0.0:
            raise UserError(f"collider sampled: spacing={self.spacing} is out of range; accepted: above 0 m")

    def pivot(self, like: Tensor) -> Tensor:
        edges = like.new_tensor(self.distances.shape) - 1.0
        return as_tensor(self.low, like) + 0.5 * self.spacing * edges

    def distance(self, points: Points) -> tuple[Distances, Points]:
        place = (points - as_tensor(self.low, points)[:, None]) / self.spacing
        most = place.new_tensor(self.distances.shape)[:, None] - 1.0
        within = torch.minimum(place.clamp_min(0.0), most)
        value, slope = trilinear(_samples(self, points.device), within)
        beyond = self.spacing * (place - within)
        squared = beyond.square().sum(0)
        out = squared > 0.0
        from_out = value * torch.where(beyond == 0.0, slope / self.spacing, 0.0) + beyond
        distance = torch.where(out, (torch.where(out, squared, 1.0) + value.square()).sqrt(), value)
        return distance, unit(torch.where(out, from_out, slope))

    def key(self) -> tuple[object, ...]:
        digest = hashlib.blake2b(self.distances.tobytes()).hexdigest()
        return (type(self), digest, self.distances.shape, self.low, self.spacing)


@lru_cache(maxsize=16)
def _samples(shape: Sampled, device: torch.device) -> Float[Tensor, "x y z"]:
    with torch.inference_mode(False):
        return torch.from_numpy(shape.distances).to(device)


@dataclass(frozen=True, eq=False)
class SignedDistance(Shape):
    """A function of positions [m], (points, 3), and the time [s], that gives signed distances [m], (points,).

    It is asked in the frame of the domain: what moves, moves in the function.
    """

    function: Callable[[Tensor, float], Tensor]
    word = "signed_distance"

    def __post_init__(self) -> None:
        if not callable(self.function):
            raise UserError(f"collider signed_distance: {self.function!r} is not accepted; accepted: a function")

    def pivot(self, like: Tensor) -> Tensor:
        return like.new_zeros(3)

    def distance_at(self, points: Points, time: float) -> tuple[Distances, Points]:
        """As distance, at a time [s]; the normal is the gradient of the function."""
        with torch.enable_grad():
            places = points.detach().T.clone().requires_grad_()
            distance = self._called(places, time)
            if not isinstance(distance, Tensor) or distance.shape != places.shape[:1]:
                raise UserError(
                    f"collider signed_distance: of {len(places)} positions the function gave {_described(distance)}; "
                    f"accepted: a tensor of ({len(places)},)"
                )
            if not distance.requires_grad:
                raise UserError(
                    "collider signed_distance: what the function gave does not depend on the positions; accepted: "
                    "distances made of them by operations of PyTorch"
                )
            differentiated = _leaves(distance) - {places}
            (slope,) = torch.autograd.grad(distance.sum(), places, create_graph=bool(differentiated))
        if not differentiated or not torch.is_grad_enabled():
            distance, slope = distance.detach(), slope.detach()
        return distance, unit(slope.T)

    def _called(self, places: Tensor, time: float) -> object:
        try:
            return self.function(places, time)
        except UserError:
            raise
        except Exception as error:  # whatever their code raises
            raise UserError(f"collider signed_distance: the function fails: {type(error).__name__}: {error}") from error


def _leaves(value: Tensor) -> set[Tensor]:
    """The tensors that a value is differentiated with respect to."""
    found: set[Tensor] = set()
    seen, left = set(), [value.grad_fn]
    while left:
        node = left.pop()
        if node is None or node in seen:
            continue
        seen.add(node)
        leaf = getattr(node, "variable", None)
        if leaf is not None:
            found.add(leaf)
        left += [below for below, _ in node.next_functions]
    return found


def of_mesh(
    path: str | Path | tuple[Any, Any],
    spacing: Real | None = None,
    side: Real | None = None,
    centre: Sequence[Real] | None = None,
) -> Sampled:
    """The inside of a watertight surface mesh.

    path     of a file that trimesh reads, or vertices (V, 3) and triangles (F, 3)
    spacing  of the nodes [m], at most; None: a 64th of the longest edge of the bounding box
    side     that edge [m], to which the mesh is scaled; None: as in the file, in metres
    centre   of the bounding box [m]; None: where it is
    raises   UserError, one line, for whatever is wrong with the mesh
    """
    # trimesh and a search tree, which other shapes do without
    from pcnclaws.geometry.mesh_distance import sampled_surface
    from pcnclaws.geometry.mesh_sources import surface_of

    what = "collider mesh"
    surface = surface_of(path, f"{what}: path")
    side = surface.unit if side is None else float(plain(as_number(what, "side", side)))
    if not side > 0.0:
        raise UserError(f"{what}: side={side} is out of range; accepted: above 0 m")
    middle = surface.middle if centre is None else np.array(scalars(as_vector(what, "centre", centre)))
    spacing = side / MESH_CELLS if spacing is None else float(plain(as_number(what, "spacing", spacing)))
    if not side / MOST_MESH_CELLS <= spacing * (1.0 + 1e-9) or not spacing <= side / FEWEST_MESH_CELLS * (1.0 + 1e-9):
        raise UserError(
            f"{what}: spacing={spacing} is out of range; accepted: {side / MOST_MESH_CELLS:.3g} to "
            f"{side / FEWEST_MESH_CELLS:.3g} m, for its longest edge of {side:.3g} m"
        )
    found = sampled_surface(surface, math.ceil(side / spacing * (1.0 - 1e-9)))
    return Sampled(side * found.distances, tuple((middle + side * found.low).tolist()), side * found.spacing)


def _described(value: object) -> str:
    return str(tuple(value.shape)) if isinstance(value, Tensor) else type(value).__name__
