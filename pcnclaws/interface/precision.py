"""In which precision and where a scene runs: where the caller says so, or as the tensors that it was given."""

from collections.abc import Iterable
from functools import reduce
from typing import Any, NamedTuple

import torch
from torch import Tensor

from pcnclaws.errors import UserError

PRECISIONS = (torch.float32, torch.float64)


class Precision(NamedTuple):
    """Floating-point type and device of a run."""

    dtype: torch.dtype
    device: torch.device


def precision_of(
    dtype: torch.dtype | None, device: str | torch.device | None, here: Iterable[Any], others: Iterable[Any]
) -> Precision:
    """The precision and the device of a run; what is None is that of the tensors, else single precision on the CPU.

    here    what this call was given, tensors among it
    others  what the scene was given: it decides where `here` holds no tensor
    raises  UserError for another type, a device that is not there, and tensors on several devices
    """
    tensors = _floating(here) or _floating(others)
    if dtype is None:
        dtype = reduce(torch.promote_types, (one.dtype for one in tensors), torch.float32)
    if dtype not in PRECISIONS:
        raise UserError(f"dtype={dtype} is not accepted; accepted: torch.float32, torch.float64")
    if device is None:
        devices = {one.device for one in tensors} or {torch.device("cpu")}
        if len(devices) > 1:
            raise UserError(f"the tensors are on {' and '.join(sorted(map(str, devices)))}; accepted: one device")
        device = devices.pop()
    return Precision(dtype, _device(device))


def _floating(given: Iterable[Any]) -> list[Tensor]:
    """The tensors among given things, those of colliders and loads among them."""
    found: list[Any] = []
    for thing in given:
        of_several = thing if isinstance(thing, tuple | list) else ()
        found += [thing, *(tensor for one in of_several if hasattr(one, "tensors") for tensor in one.tensors())]
    return [one for one in found if isinstance(one, Tensor) and one.is_floating_point()]


def _device(device: str | torch.device) -> torch.device:
    there = "cpu, cuda" if torch.cuda.is_available() else "cpu"
    try:
        found = torch.device(device)
    except RuntimeError as error:
        raise UserError(f"device={device} is not known; accepted: {there}") from error
    if found.type not in there:
        raise UserError(f"device={device} is not available here; accepted: {there}")
    return found
