"""Derivatives of a motion in reverse mode, in forward mode and by central differences, through an impact and yield."""

import copy
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import torch
from torch import Tensor
from torch.autograd import forward_ad

import pcnclaws as pc
from benchmarks.stress.cases import FLOOR, ROOM, law_of
from pcnclaws.compiled.backend import using_backend

# Relative agreement that is asked for where the motion is smooth.
AGREEMENT = 1e-6
# Steps of central differences relative to the value; the best of them counts: rounding and curvature both bound them.
RELATIVE_STEPS = (1e-4, 1e-5, 1e-6, 1e-7)
# What is differentiated with respect to.
UNKNOWNS = ("parameters", "values of each particle", "start velocity", "friction of an obstacle", "weights")
VELOCITY, FRICTION = torch.tensor((0.4, -2.0, 0.2), dtype=torch.float64), 0.3
LANDSCAPE_POINTS, LANDSCAPE_WIDTH = 81, 2e-3


class Problem(NamedTuple):
    """A number of a motion as a function of t: each value of the unknown is changed by the share t of a direction.

    value    t -> the number, differentiable
    reverse  its derivative at 0 in reverse mode, where autograd.grad of `value` is not how it is had
    """

    value: Callable[[Tensor], Tensor]
    reverse: Callable[[], float] | None = None


def problem(material: str, unknown: str, steps: int) -> Problem:
    """The mean of the final positions, each with a weight of its own, of a small body that falls onto a slope."""
    law = law_of(material, "shipped" if unknown == "weights" else "analytic")
    scene = _falling(law)
    generator = torch.Generator().manual_seed(0)
    weights = torch.rand(len(scene.body), 3, generator=generator, dtype=torch.float64) / len(scene.body)
    middle = {name: 0.5 * (low + high) for name, (low, high) in law.ranges.items()}
    each = middle["youngs_modulus"] * torch.rand(len(scene.body), generator=generator, dtype=torch.float64)

    def measured(**changes: Any) -> Tensor:
        return (scene.with_(**changes).rollout(steps, steps, dtype=torch.float64)[-1] * weights).sum()

    directions: dict[str, Callable[[Tensor], dict[str, Any]]] = {
        "parameters": lambda t: {name: value * (1.0 + t) for name, value in middle.items()},
        "values of each particle": lambda t: {"youngs_modulus": middle["youngs_modulus"] + t * each},
        "start velocity": lambda t: {"velocity": VELOCITY * (1.0 + t)},
        "friction of an obstacle": lambda t: {"colliders": [_slope(FRICTION * (1.0 + t))]},
        "weights": lambda t: {"law": _with_weights(law, t)},
    }

    def in_reverse() -> float:
        trained = copy.deepcopy(law).double().requires_grad_()
        weights_now = list(trained.parameters())
        gradients = torch.autograd.grad(measured(law=trained), weights_now)
        return sum(float((one * weight.detach()).sum()) for one, weight in zip(gradients, weights_now, strict=True))

    return Problem(lambda t: measured(**directions[unknown](t)), in_reverse if unknown == "weights" else None)


def compare(material: str, unknown: str, steps: int, backend: str) -> dict[str, Any]:
    """{"reverse", "forward", "difference", "forward_error", "difference_error"}: derivatives and relative deviations.

    Kernels have no forward mode for weights: "forward" is missing then.
    """
    value, in_reverse = problem(material, unknown, steps)
    zero = torch.zeros((), dtype=torch.float64)
    with using_backend(backend):
        row = {"reverse": _reverse(value, zero) if in_reverse is None else in_reverse()}
        if unknown != "weights" or backend == "torch":
            row["forward"] = _forward(value, zero)
        with torch.no_grad():
            found = [float((value(zero + h) - value(zero - h)) / (2.0 * h)) for h in RELATIVE_STEPS]
    row["difference"] = min(found, key=lambda one: abs(one - row["reverse"]))
    for mode in ("forward", "difference"):
        if mode in row:
            row[f"{mode}_error"] = abs(row[mode] - row["reverse"]) / max(abs(row["reverse"]), 1e-12)
    return row


def _falling(law: pc.ConstitutiveModel) -> pc.Scene:
    body = pc.Body.cube(side=0.1, centre=(0.5, FLOOR + 0.075, 0.5), particles_per_edge=4)
    scene = pc.Scene(
        body, law, velocity=VELOCITY, spin=(0.0, 0.0, 2.0), settings=ROOM, colliders=[_slope(torch.tensor(FRICTION))]
    )
    return scene.with_(settings=pc.Settings(time_step=0.5 * scene.time_step))


def _slope(friction: Tensor) -> pc.Collider:
    return pc.Collider.plane((0.5, FLOOR + 0.02, 0.5), (0.1, 1.0, 0.05), friction=friction)


def _with_weights(law: pc.ConstitutiveModel, t: Tensor) -> pc.ConstitutiveModel:
    """The law with its weights w (1 + t); as plain tensors, which carry derivatives, where t does."""
    moved = copy.deepcopy(law).double().requires_grad_(False)
    if forward_ad.unpack_dual(t).tangent is None:
        for weight in moved.parameters():
            weight.mul_(1.0 + t)
        return moved
    for module in moved.modules():
        for name, weight in list(module.named_parameters(recurse=False)):
            delattr(module, name)
            setattr(module, name, weight * (1.0 + t))
    return moved


def _reverse(value: Callable[[Tensor], Tensor], zero: Tensor) -> float:
    t = zero.clone().requires_grad_()
    return float(torch.autograd.grad(value(t), t)[0])


def _forward(value: Callable[[Tensor], Tensor], zero: Tensor) -> float:
    with forward_ad.dual_level():
        _, tangent = forward_ad.unpack_dual(value(forward_ad.make_dual(zero, torch.ones_like(zero))))
        return 0.0 if tangent is None else float(tangent)


def landscape(material: str, unknown: str, steps: int, width: float = LANDSCAPE_WIDTH) -> Mapping[str, list[float]]:
    """The number along the direction, {"t", "value"}: what a derivative is the slope of."""
    value, _ = problem(material, unknown, steps)
    ts = torch.linspace(-width, width, LANDSCAPE_POINTS, dtype=torch.float64)
    with torch.no_grad():
        return {"t": ts.tolist(), "value": [float(value(t)) for t in ts]}
