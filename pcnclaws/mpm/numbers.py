"""Numbers of colliders and loads: plain ones, or tensors that may carry derivatives."""

import math
from collections.abc import Sequence
from typing import Any, TypeAlias

import torch
from torch import Tensor

from pcnclaws.errors import UserError

Real: TypeAlias = float | int
Number: TypeAlias = float | int | Tensor
Numbers: TypeAlias = Sequence[float | int] | Tensor

# Times are compared with this tolerance [s].
TIME_TOLERANCE = 1e-9


def as_number(what: str, name: str, value: Number) -> Number:
    """A finite number, a tensor as it is."""
    if isinstance(value, Tensor) and value.numel() == 1:
        return value
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise UserError(f"{what}: {name}={value} is not accepted; accepted: a finite number")
    return float(value)


def as_vector(what: str, name: str, value: Numbers) -> tuple[float, ...] | Tensor:
    """Three finite numbers, a tensor of three as it is."""
    if isinstance(value, Tensor) and value.shape == (3,):
        return value
    numbers = list(value) if isinstance(value, Sequence) and not isinstance(value, str) else []
    if len(numbers) != 3 or any(isinstance(x, (bool, str)) or not math.isfinite(float(x)) for x in numbers):
        raise UserError(f"{what}: {name}={_shown(value)} is not accepted; accepted: three finite numbers")
    return tuple(float(x) for x in numbers)


def require_span(what: str, start: Real, end: Real | None) -> None:
    """Refuses a time span that never begins, or is empty, with a UserError."""
    if not math.isfinite(start):
        raise UserError(f"{what}: start={start} is not accepted; accepted: a finite time [s]")
    if end is not None and not end > start:
        raise UserError(f"{what}: end={end} is not after start={start:g}; accepted: a later time [s], or null")


def span_holds(start: Real, end: Real | None, time: float) -> bool:
    """Whether a time lies in a span, its end not included."""
    return time >= start - TIME_TOLERANCE and (end is None or time < end - TIME_TOLERANCE)


def as_tensor(value: Number | Numbers, like: Tensor) -> Tensor:
    """A number or a vector as a tensor like another one."""
    return value.to(like) if isinstance(value, Tensor) else torch.tensor(value, dtype=like.dtype, device=like.device)


def plain(value: Any) -> Any:
    """A number, a vector or a word without tensors."""
    if isinstance(value, Tensor):
        value = value.detach().tolist()
    return list(value) if isinstance(value, tuple) else value


def scalars(vector: Numbers) -> list[float]:
    """The numbers of a vector, without derivatives."""
    return vector.detach().tolist() if isinstance(vector, Tensor) else [float(x) for x in vector]


def _shown(value: object) -> object:
    return list(value) if isinstance(value, tuple) else value
