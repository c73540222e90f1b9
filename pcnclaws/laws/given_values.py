"""Physical parameters as a program gives them: numbers, tensors of one value, or one value a particle."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
import torch
from torch import Tensor

from pcnclaws.errors import UserError, unknown_name
from pcnclaws.laws.parameters import Parameter

Value: TypeAlias = float | int | Tensor | np.ndarray


def checked_values(
    given: Mapping[str, Any], known: Sequence[Parameter], shape: Sequence[int], others: Sequence[str] = ()
) -> dict[str, float | Tensor]:
    """Given values of physical parameters, each a number, a tensor () or a tensor of the shape of the particles.

    Tensors stay as they are in precision, place and derivatives.
    known   the parameters that are accepted
    shape   of the particles: a value for each of them has it
    others  further names of the call, for the message
    raises  UserError for unknown names with the nearest known one, and for values that are not accepted
    """
    parameters = {parameter.name: parameter for parameter in known}
    for name in given:
        if name not in parameters:
            raise unknown_name("parameters", name, (*parameters, *others))
    return {name: _checked(parameters[name], value, tuple(shape)) for name, value in given.items()}


def require_values(given: Mapping[str, Any], needed: Sequence[Parameter]) -> None:
    """Refuses missing parameters with a UserError that names the first one."""
    for parameter in needed:
        if parameter.name not in given:
            raise UserError(f"parameters.{parameter.name} is missing; accepted: {parameter.accepted}")


def of_particles(values: Mapping[str, float | Tensor], shape: Sequence[int], like: Tensor) -> dict[str, Tensor]:
    """The values as tensors of the shape of the particles, in the precision and the place of `like`."""
    return {
        name: torch.as_tensor(value, dtype=like.dtype, device=like.device).expand(tuple(shape)).contiguous()
        for name, value in values.items()
    }


def _checked(parameter: Parameter, value: Any, shape: tuple[int, ...]) -> float | Tensor:
    if isinstance(value, np.ndarray):
        value = torch.tensor(value) if value.dtype.kind in "fiu" else value.tolist()
    if not isinstance(value, Tensor):
        number = value.item() if isinstance(value, np.generic) else value
        _require_accepted(parameter, number)
        return float(number)
    if value.dtype == torch.bool or value.is_complex():
        raise UserError(f"parameters.{parameter.name} is a tensor of {value.dtype}; accepted: real numbers")
    value = value.reshape(()) if value.numel() == 1 else value
    if value.shape not in ((), shape):
        raise UserError(
            f"parameters.{parameter.name} has the shape {tuple(value.shape)}; accepted: a number, a tensor of one "
            f"value, or one value a particle, {shape}"
        )
    for extreme in _extremes(value.detach()):
        _require_accepted(parameter, extreme)
    return value


def _require_accepted(parameter: Parameter, value: Any) -> None:
    if isinstance(value, bool) or not isinstance(value, float | int) or not parameter.accepts(float(value)):
        raise UserError(f"parameters.{parameter.name}={value} is not accepted; accepted: {parameter.accepted}")


def _extremes(values: Tensor) -> list[float]:
    """The smallest and the largest value, or one that is not finite."""
    if not values.numel():
        return []
    ends = [float(values.min()), float(values.max())]
    return ends if all(map(math.isfinite, ends)) else [float(values[~torch.isfinite(values)].reshape(-1)[0])]
