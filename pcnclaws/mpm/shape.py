"""A shape: what a collider is made of, a signed distance that knows which way is out."""

from dataclasses import dataclass
from typing import ClassVar

import torch
from jaxtyping import Float
from torch import Tensor

from pcnclaws.errors import UserError
from pcnclaws.mpm.numbers import as_number, as_vector, plain
from pcnclaws.tensors.tensor_types import Vectors

Points = Vectors  # of grid nodes here
Distances = Float[Tensor, " points"]


@dataclass(frozen=True, eq=False)
class Shape:
    """What a collider is made of: vectors [m] and lengths [m], numbers or tensors that may carry derivatives."""

    word: ClassVar[str]
    lengths: ClassVar[tuple[str, ...]] = ("radius",)

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            checked = as_number if name in self.lengths else as_vector
            object.__setattr__(self, name, checked(f"collider {self.word}", name, value))
            if name in self.lengths and not plain(getattr(self, name)) > 0.0:
                raise UserError(
                    f"collider {self.word}: {name}={value} is out of range; accepted: a positive length [m]"
                )

    def pivot(self, like: Tensor) -> Tensor:
        """About what it turns [m], (3,)."""
        raise NotImplementedError

    def distance(self, points: Points) -> tuple[Distances, Points]:
        """Signed distance [m], negative inside, and outward unit normal, at points [m], (3, points)."""
        raise NotImplementedError

    def __deepcopy__(self, memo: object) -> "Shape":
        return self  # a copy of a tensor would lose its derivatives

    def key(self) -> tuple[object, ...]:
        """What makes two shapes the same: their kind and numbers, and tensors by themselves."""
        return (type(self), *hashable(self))


def hashable(value: object) -> tuple[object, ...]:
    """The fields of an object, tensors by themselves: equal only to the very same tensors."""
    return tuple(id(field) if isinstance(field, Tensor) else field for field in vars(value).values())


def unit(vectors: Points) -> Points:
    """Vectors of length 1, 0 for those that are 0."""
    squared = vectors.square().sum(0)
    long = squared > 0.0
    return torch.where(long, vectors / torch.where(long, squared, 1.0).sqrt(), 0.0)
