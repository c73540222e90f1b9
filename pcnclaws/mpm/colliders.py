"""Colliders: obstacles with a signed distance, a motion and a contact. Everything of one shape is in this file.

A shape is a dataclass of its numbers. It says how far points are from it where it is at the start, which way is out,
and about which point it turns. SHAPES names it for options and files; a method of Collider makes it in Python.
"""

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import Any, NamedTuple, TypedDict, Unpack

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from pcnclaws.errors import UserError, unknown_name
from pcnclaws.mpm.contact import CONTACTS, require_friction
from pcnclaws.mpm.distance_fields import Sampled, SignedDistance, of_mesh
from pcnclaws.mpm.numbers import (
    Number,
    Numbers,
    Real,
    as_number,
    as_tensor,
    as_vector,
    plain,
    require_span,
    scalars,
    span_holds,
)
from pcnclaws.mpm.shape import Distances, Points, Shape, hashable

ZERO = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Plane(Shape):
    """The half-space below a plane through `point`; `normal`, of any length, points out of it."""

    point: Numbers
    normal: Numbers
    word = "plane"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not any(scalars(self.normal)):
            raise UserError("collider plane: normal=[0, 0, 0] is not accepted; accepted: a direction")

    def pivot(self, like: Tensor) -> Tensor:
        return as_tensor(self.point, like)

    def distance(self, points: Points) -> tuple[Distances, Points]:
        normal = as_tensor(self.normal, points)
        normal = (normal / normal.norm())[:, None]
        return (normal * (points - self.pivot(points)[:, None])).sum(0), normal.expand_as(points)


@dataclass(frozen=True, eq=False)
class Sphere(Shape):
    """A ball."""

    centre: Numbers
    radius: Number
    word = "sphere"

    def pivot(self, like: Tensor) -> Tensor:
        return as_tensor(self.centre, like)

    def distance(self, points: Points) -> tuple[Distances, Points]:
        return _round(points - self.pivot(points)[:, None], as_tensor(self.radius, points))


@dataclass(frozen=True, eq=False)
class Box(Shape):
    """A box along the axes between two corners."""

    low: Numbers
    high: Numbers
    word = "box"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not all(a < b for a, b in zip(scalars(self.low), scalars(self.high), strict=True)):
            raise UserError(
                f"collider box: low={scalars(self.low)} is not below high={scalars(self.high)}; accepted: corners"
            )

    def pivot(self, like: Tensor) -> Tensor:
        return 0.5 * (as_tensor(self.low, like) + as_tensor(self.high, like))

    def distance(self, points: Points) -> tuple[Distances, Points]:
        half = 0.5 * (as_tensor(self.high, points) - as_tensor(self.low, points))
        from_middle = points - self.pivot(points)[:, None]
        return _of_box(from_middle.abs() - half[:, None], torch.where(from_middle < 0.0, -1.0, 1.0).to(points))


@dataclass(frozen=True, eq=False)
class _AboutAxis(Shape):
    """A body about the segment between two points."""

    from_point: Numbers
    to_point: Numbers
    radius: Number

    def __post_init__(self) -> None:
        super().__post_init__()
        if scalars(self.from_point) == scalars(self.to_point):
            raise UserError(f"collider {self.word}: its two points are one; accepted: two points")

    def pivot(self, like: Tensor) -> Tensor:
        return 0.5 * (as_tensor(self.from_point, like) + as_tensor(self.to_point, like))

    def from_axis(self, points: Points) -> tuple[Tensor, Tensor, Tensor, Points]:
        """Unit vector of the axis, half its length [m]; of points height along it, and vectors from its middle."""
        between = as_tensor(self.to_point, points) - as_tensor(self.from_point, points)
        length = between.norm()
        from_middle = points - self.pivot(points)[:, None]
        along = between / length
        return along[:, None], 0.5 * length, (along[:, None] * from_middle).sum(0), from_middle


@dataclass(frozen=True, eq=False)
class Capsule(_AboutAxis):
    """All within `radius` of the segment between two points."""

    word = "capsule"

    def distance(self, points: Points) -> tuple[Distances, Points]:
        along, half, height, from_middle = self.from_axis(points)
        return _round(from_middle - along * height.clamp(-half, half), as_tensor(self.radius, points))


@dataclass(frozen=True, eq=False)
class Cylinder(_AboutAxis):
    """A cylinder with flat ends about the segment between two points."""

    word = "cylinder"

    def distance(self, points: Points) -> tuple[Distances, Points]:
        along, half, height, from_middle = self.from_axis(points)
        to_side, outward = _round(from_middle - along * height, as_tensor(self.radius, points))
        # a box in the plane of radius and height
        distance, normal = _of_box(torch.stack((to_side, height.abs() - half)), torch.ones_like(points[:2]))
        return distance, normal[0] * outward + normal[1] * torch.where(height < 0.0, -1.0, 1.0) * along


SHAPES: Mapping[str, type[Shape]] = {shape.word: shape for shape in (Plane, Sphere, Box, Capsule, Cylinder, Sampled)}
# What options may say beside: it opens the file that they name.
OPENING: Mapping[str, Callable[..., Shape]] = {"mesh": of_mesh}


class Motion(TypedDict, total=False):
    """What every collider may be given beside its shape: the fields of Collider."""

    contact: str
    friction: Number
    velocity: Numbers
    spin: Numbers
    start: Real
    end: Real | None


class NodesInside(NamedTuple):
    """The grid nodes that a collider acts on: their numbers in the grid, outward normals, and its velocity there."""

    numbers: Int64[Tensor, " nodes"]
    normal: Float[Tensor, "3 nodes"]
    velocity: Float[Tensor, "3 nodes"]


@dataclass(frozen=True, eq=False)
class Collider:
    """An obstacle: it acts on the grid nodes in it.

    contact     'separate', 'slip' or 'sticky', see mpm/contact.py
    friction    Coulomb's coefficient mu [-]
    velocity    of the point about which it turns [m/s]
    spin        [rad/s], about that point
    start, end  it acts from start [s], where its motion begins, until before end, None for good

    Friction, velocity, spin and the numbers of shapes may be tensors, which may carry derivatives.
    """

    shape: Shape
    contact: str = "separate"
    friction: Number = 0.0
    velocity: Numbers = ZERO
    spin: Numbers = ZERO
    start: Real = 0.0
    end: Real | None = None

    def __post_init__(self) -> None:
        what = f"collider {self.shape.word}"
        if self.contact not in CONTACTS:
            raise unknown_name(f"{what}: contact", self.contact, CONTACTS)
        object.__setattr__(self, "friction", as_number(what, "friction", self.friction))
        require_friction(f"{what}: friction", self.friction, "contact", self.contact)
        object.__setattr__(self, "velocity", as_vector(what, "velocity", self.velocity))
        object.__setattr__(self, "spin", as_vector(what, "spin", self.spin))
        require_span(what, self.start, self.end)

    @classmethod
    def plane(cls, point: Numbers, normal: Numbers, **motion: Unpack[Motion]) -> "Collider":
        """The half-space below a plane through point [m]; normal points out of it."""
        return cls._of(Plane(point, normal), motion)

    @classmethod
    def sphere(cls, centre: Numbers, radius: Number, **motion: Unpack[Motion]) -> "Collider":
        """A ball [m]."""
        return cls._of(Sphere(centre, radius), motion)

    @classmethod
    def box(cls, low: Numbers, high: Numbers, **motion: Unpack[Motion]) -> "Collider":
        """A box along the axes between two corners [m]; it turns about its middle."""
        return cls._of(Box(low, high), motion)

    @classmethod
    def capsule(cls, from_point: Numbers, to_point: Numbers, radius: Number, **motion: Unpack[Motion]) -> "Collider":
        """All within radius of the segment between two points [m]; it turns about the middle of it."""
        return cls._of(Capsule(from_point, to_point, radius), motion)

    @classmethod
    def cylinder(cls, from_point: Numbers, to_point: Numbers, radius: Number, **motion: Unpack[Motion]) -> "Collider":
        """A cylinder with flat ends about the segment between two points [m]; it turns about the middle of it."""
        return cls._of(Cylinder(from_point, to_point, radius), motion)

    @classmethod
    def mesh(
        cls,
        source: str | Path | tuple[Any, Any],
        *,
        spacing: Real | None = None,
        side: Real | None = None,
        centre: Sequence[Real] | None = None,
        **motion: Unpack[Motion],
    ) -> "Collider":
        """The inside of a watertight surface mesh, in metres and where it is unless `side` and `centre` say otherwise.

        Its signed distance is sampled once, on a grid of nodes. It turns about the centre of its bounding box.
        source   a file that trimesh reads, or vertices (V, 3) and triangles (F, 3)
        spacing  of the nodes [m], at most; None: a 64th of the longest edge of the bounding box
        side     longest edge of the bounding box [m], to which the mesh is scaled
        centre   of the bounding box [m]
        raises   UserError, one line, for whatever is wrong with the mesh
        """
        return cls._of(of_mesh(source, spacing, side, centre), motion)

    @classmethod
    def signed_distance(cls, function: Callable[[Tensor, float], Tensor], **motion: Unpack[Motion]) -> "Collider":
        """A function of positions [m], (points, 3), and time [s], that gives signed distances [m], (points,).

        The velocity and the spin, about the origin, are those of the surface; they do not move the function.
        """
        return cls._of(SignedDistance(function), motion)

    @classmethod
    def from_options(cls, options: Mapping[str, Any], where: str = "collider", opens_files: bool = False) -> "Collider":
        """A collider of `shape`, a word of SHAPES, and the fields of the shape and of Collider.

        opens_files  accept the words of OPENING, too: shapes that are read from a file that the options name
        raises       UserError for what is unknown, missing or wrong
        """
        word = str(options.get("shape"))
        makers = {**SHAPES, **(OPENING if opens_files else {})}
        if word not in makers:
            raise unknown_name(f"{where}.shape", word, makers)
        given = {name: value for name, value in options.items() if name != "shape"}
        own = inspect.signature(makers[word]).parameters
        _check_names(where, given, set(own))
        if missing := sorted(name for name, one in own.items() if one.default is one.empty and name not in given):
            raise UserError(f"{where}: shape={word} needs {', '.join(missing)}")
        try:
            shape = makers[word](**{name: value for name, value in given.items() if name in own})
            return cls(shape, **{name: value for name, value in given.items() if name not in own})
        except UserError as error:
            raise UserError(f"{where}: {error}") from error

    def to_options(self) -> dict[str, Any]:
        """What from_options makes it again of: plain numbers, words and arrays, what has its default left out.

        raises  UserError for a function, which no file can hold
        """
        if self.shape.word not in SHAPES:
            raise UserError(
                f"a collider {self.shape.word} is a function, which a trajectory file does not hold; accepted: the "
                "other shapes, or a motion as .npz, .ply, .vtu"
            )
        motion = {one.name: getattr(self, one.name) for one in fields(self)[1:] if one.default is not MISSING}
        changed = {name: value for name, value in motion.items() if not _same(value, _DEFAULTS[name])}
        options = {"shape": self.shape.word, **vars(self.shape), **changed}
        return {name: plain(value) for name, value in options.items()}

    @property
    def moves(self) -> bool:
        """Whether it is not always there, in the same place."""
        still = not any(map(_may_move, (self.velocity, self.spin)))
        return not still or self.start > 0.0 or self.end is not None or isinstance(self.shape, SignedDistance)

    def tensors(self) -> list[Tensor]:
        """Its numbers that are tensors, which may carry derivatives."""
        return [value for owner in (self, self.shape) for value in vars(owner).values() if isinstance(value, Tensor)]

    def speed(self, reach: float) -> float:
        """The largest speed of its points at most `reach` from the point about which it turns [m/s]."""
        velocity, spin = (math.hypot(*scalars(vector)) for vector in (self.velocity, self.spin))
        return velocity + spin * reach if spin else velocity

    def distance(self, points: Points, time: float) -> tuple[Distances, Points, Points]:
        """Signed distance [m], outward normal, and the collider's velocity [m/s] at points [m] at a time [s]."""
        velocity, spin = as_tensor(self.velocity, points), as_tensor(self.spin, points)
        pivot = self.shape.pivot(points)
        middle = pivot
        if not isinstance(self.shape, SignedDistance):
            middle = pivot + velocity * (time - self.start)
        from_middle = points - middle[:, None]
        surface = velocity[:, None].expand_as(points)
        if not _may_move(self.spin):
            at_start = points if middle is pivot or not _may_move(self.velocity) else from_middle + pivot[:, None]
            distance, normal = self._of_shape(at_start, points, time)
            return distance, normal, surface
        surface = surface + torch.linalg.cross(spin[:, None].expand_as(points), from_middle, dim=0)
        if isinstance(self.shape, SignedDistance):
            distance, normal = self._of_shape(points, points, time)
            return distance, normal, surface
        turn = torch.linalg.matrix_exp(_cross_matrix(spin) * (time - self.start))
        distance, normal = self._of_shape(turn.T @ from_middle + pivot[:, None], points, time)
        return distance, turn @ normal, surface

    def nodes_inside(self, points: Points, reach: float, time: float) -> NodesInside | None:
        """The nodes that it acts on at a time [s]: those at most `reach` [m] from it; None while it does not act."""
        if not span_holds(self.start, self.end, time):
            return None
        distance, normal, velocity = self.distance(points, time)
        numbers = (distance.detach() <= reach).nonzero()[:, 0]
        return NodesInside(numbers, normal[:, numbers], velocity[:, numbers])

    def __deepcopy__(self, memo: object) -> "Collider":
        return self  # a copy of a tensor would lose its derivatives

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Collider) and self._key() == other._key()

    def __hash__(self) -> int:
        return hash(self._key())

    def _key(self) -> tuple[object, ...]:
        return (self.shape.key(), *hashable(self)[1:])

    @classmethod
    def _of(cls, shape: Shape, motion: Motion) -> "Collider":
        _check_names(f"collider {shape.word}", motion, {one.name for one in fields(type(shape))})
        return cls(shape, **motion)

    def _of_shape(self, at_start: Points, points: Points, time: float) -> tuple[Distances, Points]:
        if isinstance(self.shape, SignedDistance):
            return self.shape.distance_at(points, time)
        return self.shape.distance(at_start)


_DEFAULTS = {one.name: one.default for one in fields(Collider)[1:]}


def _check_names(where: str, given: Mapping[str, Any], own: set[str]) -> None:
    known = sorted({*own, *_DEFAULTS})
    for name in given:
        if name not in known:
            raise unknown_name(where, name, known)


def _round(from_axis: Points, radius: Tensor) -> tuple[Distances, Points]:
    """Distance and normal of what lies within a radius, from vectors away from its axis; no normal on the axis."""
    squared = from_axis.square().sum(0)
    off = squared > 0.0
    length = torch.where(off, squared, 1.0).sqrt()
    return torch.where(off, length, 0.0) - radius, torch.where(off, from_axis / length, 0.0)


def _of_box(beyond: Tensor, side: Tensor) -> tuple[Distances, Tensor]:
    """Distance and normal of a box, from how far points are beyond its faces along each axis, and on which side."""
    outside = beyond.clamp_min(0.0)
    squared = outside.square().sum(0)
    off = squared > 0.0
    length = torch.where(off, squared, 1.0).sqrt()
    deepest, axis = beyond.max(0)
    face = torch.zeros_like(beyond).scatter(0, axis[None], 1.0)
    return torch.where(off, length, deepest), torch.where(off, outside / length, face) * side


def _cross_matrix(vector: Tensor) -> Tensor:
    """The matrix of the cross product with a vector, (3, 3)."""
    x, y, z = vector
    none = torch.zeros_like(x)
    return torch.stack((none, -z, y, z, none, -x, -y, x, none)).view(3, 3)


def _may_move(vector: Numbers) -> bool:
    return isinstance(vector, Tensor) or any(vector)


def _same(value: object, default: object) -> bool:
    return not isinstance(value, Tensor) and value == default
