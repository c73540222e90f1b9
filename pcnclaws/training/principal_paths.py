"""Loading paths in principal axes: measured stress as a linear function of principal stresses, axes found once."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from pcnclaws.data.loading_paths import LoadingPath
from pcnclaws.errors import UserError

# Newton's method for free sides: steps, the longest of one [-], and the stress that is left over the largest one.
STEPS, LONGEST, LEFT = 60, 0.5, 1e-10


class PrincipalPaths(NamedTuple):
    """The points of several loading paths, and the numbers that were measured there.

    strain     principal Hencky strains [-], 0 on free sides, (3, points)
    free       principal axes whose strain follows from the law: no stress acts there, (3, points)
    specimen   of the points, (points,)
    point      that a number was measured at, (numbers,)
    share      of the principal Kirchhoff stresses in it, (numbers, 3)
    is_cauchy  whether it is to be divided by J, (numbers,)
    measured   stress over the root of the sum of its squares along the path [-], (numbers,)
    size       that root [Pa], (numbers,)
    path       that it belongs to, (numbers,)
    weight     of its path, (numbers,)
    """

    strain: Float[Tensor, "3 points"]
    free: Bool[Tensor, "3 points"]
    specimen: Int[Tensor, " points"]
    point: Int[Tensor, " numbers"]
    share: Float[Tensor, "numbers 3"]
    is_cauchy: Bool[Tensor, " numbers"]
    measured: Float[Tensor, " numbers"]
    size: Float[Tensor, " numbers"]
    path: Int[Tensor, " numbers"]
    weight: Float[Tensor, " numbers"]

    def predicted(self, at: "Response") -> Float[Tensor, " numbers"]:
        """What a law gives in the place of `measured`."""
        values = (self.share * at.stress.T[self.point]).sum(1)
        return torch.where(self.is_cauchy, values / at.strain.sum(0)[self.point].exp(), values) / self.size

    def tangent(self, at: "Response", change: Float[Tensor, "3 points"]) -> Float[Tensor, " numbers"]:
        """How `predicted` changes where the principal stresses at fixed strains change, and free sides follow."""
        strain = _solved(at.tangent, self.free, -change)
        stress = change + (at.tangent @ strain.T[:, :, None])[:, :, 0].T
        values = (self.share * stress.T[self.point]).sum(1) / self.size
        volume = at.strain.sum(0)[self.point].exp()
        of_volume = strain.sum(0)[self.point] * self.predicted(at)
        return torch.where(self.is_cauchy, values / volume - of_volume, values)


class Response(NamedTuple):
    """What a law answers at the points.

    strain   principal Hencky strains [-], (3, points)
    stress   principal Kirchhoff stresses [Pa], (3, points)
    tangent  their derivatives by the strains [Pa], (points, 3, 3)
    """

    strain: Float[Tensor, "3 points"]
    stress: Float[Tensor, "3 points"]
    tangent: Float[Tensor, "points 3 3"]


def with_free_sides(law: Callable[[Tensor], Response], paths: PrincipalPaths) -> Response:
    """The response of a law where the stress of the free sides is zero, by Newton's method.

    law     of principal Hencky strains (3, points)
    raises  UserError where no such strains are found
    """
    at, left = law(paths.strain), 1.0
    for _ in range(STEPS):
        left = float((at.stress * paths.free).abs().max() / at.stress.abs().max().clamp_min(1e-300))
        if left <= LEFT:
            return at
        step = _solved(at.tangent, paths.free, -at.stress).clamp(-LONGEST, LONGEST)
        at = law(at.strain + step)
    raise UserError(f"no stretch of the free sides was found where their stress is zero ({left:.1e} of it is left)")


def _solved(tangent: Tensor, free: Tensor, right: Tensor) -> Float[Tensor, "3 points"]:
    """The strains of the free sides whose stresses are those on the right; 0 on the other sides."""
    if not bool(free.any()):
        return torch.zeros_like(right)
    both = free.T[:, :, None] & free.T[:, None, :]
    system = torch.where(both, tangent, torch.eye(3, dtype=tangent.dtype))
    return torch.linalg.solve(system, (right * free).T[:, :, None])[:, :, 0].T


def principal_paths(paths: Sequence[LoadingPath], specimens: Sequence[str], incompressible: bool) -> PrincipalPaths:
    """The points and numbers of loading paths.

    incompressible  det F = 1 gives the free sides, and the stress is that over the stress of a free side
    """
    parts = [_of_path(path, specimens.index(path.specimen), incompressible) for path in paths]
    counts = np.cumsum([0, *(len(part["specimen"]) for part in parts)])
    for number, (part, first) in enumerate(zip(parts, counts, strict=False)):
        part["point"] = part["point"] + first
        part["path"] = np.full(len(part["point"]), number)
    along = {"strain": 1, "free": 1}
    joined = {
        name: torch.from_numpy(np.concatenate([part[name] for part in parts], along.get(name, 0)))
        for name in PrincipalPaths._fields
    }
    return PrincipalPaths(**joined)


def _of_path(path: LoadingPath, specimen: int, incompressible: bool) -> dict[str, np.ndarray]:
    deformation, free = (
        (_isochoric(path), np.zeros(3, bool)) if incompressible else (path.deformation.copy(), path.free)
    )
    for order, side in enumerate(np.flatnonzero(free), 1):
        # far from all others, so that the side is an axis of its own
        deformation[:, side, side] = 1e3 * order
    square, axes = np.linalg.eigh(deformation @ deformation.transpose(0, 2, 1))
    apart = square > 1e5 if free.any() else np.zeros_like(square, bool)
    strain = np.where(apart, 0.0, 0.5 * np.log(square))
    inverse = np.linalg.inv(np.where(np.isfinite(deformation), deformation, 1.0))
    reference = path.reference if path.reference is not None else _reference(path) if incompressible else None
    shares, points, values = [], [], []
    for i, j in path.measured:
        share = axes[:, i] * axes[:, j] if path.is_cauchy else axes[:, i] * np.einsum("nck,nc->nk", axes, inverse[:, j])
        if reference is not None:
            of_side = axes[:, reference] ** 2
            pressure = float(i == j) if path.is_cauchy else inverse[:, j, i, None]
            share = share - of_side * pressure
        known = np.isfinite(path.stress[:, i, j])
        shares.append(share[known])
        points.append(np.flatnonzero(known))
        values.append(path.stress[known, i, j])
    stress = np.concatenate(values)
    size = float(np.sqrt(np.square(stress).sum()))
    count = len(stress)
    return {
        "strain": strain.T,
        "free": apart.T,
        "specimen": np.full(len(strain), specimen),
        "point": np.concatenate(points),
        "share": np.concatenate(shares),
        "is_cauchy": np.full(count, path.is_cauchy),
        "measured": stress / size,
        "size": np.full(count, size),
        "weight": np.full(count, path.weight),
    }


def _isochoric(path: LoadingPath) -> np.ndarray:
    """F with the free sides that det F = 1 gives, equal where there are two."""
    deformation, sides = path.deformation.copy(), np.flatnonzero(path.free)
    if not len(sides) or np.isfinite(deformation).all():
        return deformation
    for side in sides:
        deformation[:, side, side] = 1.0
    stretch = np.linalg.det(deformation) ** (-1.0 / len(sides))
    for side in sides:
        deformation[:, side, side] = stretch
    return deformation


def _reference(path: LoadingPath) -> int | None:
    """The side without stress that an unknown pressure is measured from; None where only shear was measured."""
    if all(i != j for i, j in path.measured):
        return None
    if not path.free.any():
        raise UserError(
            f"{path.name}: no side is free, which leaves the pressure of an incompressible body open; accepted: a free "
            "side, or stress.poissons_ratio below 0.5"
        )
    return int(np.flatnonzero(path.free)[-1])
