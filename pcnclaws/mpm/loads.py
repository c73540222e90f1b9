"""Loads: forces and accelerations on the particles that start in a box, over a time span."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import torch
from torch import Tensor

from pcnclaws.errors import UserError, unknown_name
from pcnclaws.mpm.numbers import Numbers, Real, as_vector, plain, require_span, scalars, span_holds
from pcnclaws.tensors.tensor_types import Scalars, SceneIndex, Vectors


@dataclass(frozen=True, eq=False)
class Load:
    """A load on the particles of a scene that start between two corners, faces included.

    low, high     corners [m]
    force         [N], of all these particles together, shared in proportion to their masses
    acceleration  [m/s^2], of each of them; one of the two
    start, end    it acts from start [s] until before end, None for good

    Numbers, or tensors, which may carry derivatives.
    """

    low: Numbers
    high: Numbers
    force: Numbers | None = None
    acceleration: Numbers | None = None
    start: Real = 0.0
    end: Real | None = None

    def __post_init__(self) -> None:
        low, high = (as_vector("load", name, getattr(self, name)) for name in ("low", "high"))
        given = [name for name in ("force", "acceleration") if getattr(self, name) is not None]
        if len(given) != 1:
            raise UserError(f"load: {' and '.join(given) or 'no force'} is given; accepted: force [N] or acceleration")
        object.__setattr__(self, given[0], as_vector("load", given[0], getattr(self, given[0])))
        object.__setattr__(self, "low", low)
        object.__setattr__(self, "high", high)
        if not all(a <= b for a, b in zip(scalars(low), scalars(high), strict=True)):
            raise UserError(f"load: low={list(low)} is above high={list(high)}; accepted: a lower and an upper corner")
        require_span("load", self.start, self.end)

    @classmethod
    def from_options(cls, options: Mapping[str, Any], where: str = "load") -> "Load":
        """A load of its fields by name.

        raises  UserError for what is unknown, missing or wrong
        """
        known = [one.name for one in fields(cls)]
        for name in options:
            if name not in known:
                raise unknown_name(where, name, known)
        if missing := [name for name in ("low", "high") if options.get(name) is None]:
            raise UserError(f"{where}: needs {', '.join(missing)}")
        try:
            return cls(**options)
        except UserError as error:
            raise UserError(f"{where}: {error}") from error

    def to_options(self) -> dict[str, Any]:
        """What from_options makes it again of: plain numbers."""
        return {name: plain(value) for name, value in vars(self).items() if value is not None}

    def __deepcopy__(self, memo: object) -> "Load":
        return self  # a copy of a tensor would lose its derivatives

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Load) and self.key() == other.key()

    def __hash__(self) -> int:
        return hash(self.key())

    def key(self) -> tuple[object, ...]:
        """What makes two loads the same: their numbers, and tensors by themselves."""
        return tuple(id(value) if isinstance(value, Tensor) else value for value in vars(self).values())

    def tensors(self) -> list[Tensor]:
        """Its numbers that are tensors, which may carry derivatives."""
        return [value for value in vars(self).values() if isinstance(value, Tensor)]

    def share(self, position: Vectors, mass: Scalars, scene_index: SceneIndex) -> Scalars:
        """Acceleration of each particle in units of the load's vector, 0 outside of the box.

        position  at the start [m]
        """
        low, high = (position.new_tensor(scalars(corner))[:, None] for corner in (self.low, self.high))
        inside = ((position >= low) & (position <= high)).all(0).to(mass)
        if self.force is None:
            return inside
        of_scene = mass.new_zeros(int(scene_index.max()) + 1).index_add(0, scene_index, inside * mass)[scene_index]
        return torch.where(inside > 0.0, 1.0 / torch.where(of_scene > 0.0, of_scene, 1.0), 0.0)


def load_shares(loads: Sequence[Load], position: Vectors, mass: Scalars, scene_index: SceneIndex) -> Tensor:
    """What each load gives to each particle, from their start positions, (loads, particles)."""
    shares = [load.share(position, mass, scene_index) for load in loads]
    return torch.stack(shares) if shares else mass.new_zeros(0, 0)


def load_acceleration(loads: Sequence[Load], shares: Tensor, time: float) -> Vectors | None:
    """Acceleration of all particles at a time [m/s^2], (3, particles); None where no load acts."""
    total = None
    for load, share in zip(loads, shares, strict=True):
        if span_holds(load.start, load.end, time):
            vector = torch.as_tensor(load.acceleration if load.force is None else load.force).to(share)
            total = vector[:, None] * share if total is None else total + vector[:, None] * share
    return total
