"""What programs give to scenes: vectors, lists and numbers of frames, each checked where it comes in."""

import logging
from collections.abc import Sequence
from typing import Any, TypeAlias, TypeVar

import numpy as np
import torch
from torch import Tensor

from pcnclaws.errors import UserError
from pcnclaws.interface.settings import whole_number

log = logging.getLogger(__name__)

Kind = TypeVar("Kind")
Vector: TypeAlias = Sequence[float | int] | Tensor | np.ndarray


def check_frames(steps: Any, every: Any) -> None:
    """Refuses numbers of steps that leave no frame with a UserError, and says which steps are in none."""
    steps, every = whole_number("simulation.steps", steps), whole_number("simulation.every", every)
    if every > steps:
        raise UserError(f"simulation.every={every} keeps no frame; accepted: 1 to simulation.steps={steps}")
    if steps % every:
        log.warning("simulation.every=%d: the last %d of %d steps are in no frame", every, steps % every, steps)


def all_of(name: str, given: Any, kind: type[Kind]) -> tuple[Kind, ...]:
    """Given things of one kind."""
    things = tuple(given) if isinstance(given, Sequence) else (given,)
    for thing in things:
        if not isinstance(thing, kind):
            raise UserError(f"scene.{name} holds {thing!r}; accepted: a list, each a {kind.__name__}")
    return things


def vector(name: str, value: Vector, shapes: Sequence[tuple[int, ...]]) -> Tensor:
    """A given vector, or one for each particle, in double precision, with its derivatives."""
    try:
        tensor = value if isinstance(value, Tensor) else torch.tensor(np.asarray(value, dtype=np.float64))
    except (TypeError, ValueError) as error:
        raise UserError(f"scene.{name}={value} is not accepted; accepted: three numbers") from error
    if tensor.shape not in shapes or tensor.is_complex() or tensor.dtype == torch.bool:
        accepted = " or ".join(str(shape) for shape in shapes)
        raise UserError(f"scene.{name} has the shape {tuple(tensor.shape)}; accepted: numbers {accepted}")
    tensor = tensor.to("cpu", torch.float64)
    if not bool(torch.isfinite(tensor.detach()).all()):
        raise UserError(f"scene.{name} holds numbers that are not finite")
    return tensor


def number(value: float | Tensor) -> float:
    """A plain number, without derivatives."""
    return float(value.detach() if isinstance(value, Tensor) else value)


def shown(value: float | Tensor) -> str:
    """A number, or the span of one a particle, in words."""
    if isinstance(value, Tensor) and value.dim():
        return f"{number(value.min()):g}..{number(value.max()):g}"
    return f"{number(value):g}"
