"""Losses that training minimises."""

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from pcnclaws.mpm.state import ParticleState, Scenes
from pcnclaws.simulation.free_fall import fallen
from pcnclaws.tensors.tensor_types import SceneIndex

Positions = Float[Tensor, "frames 3 particles"]
# Squared displacement (30 micrometres)^2 [m^2] below which a segment is as good as free of stress.
NEGLIGIBLE = 1e-9


def position_loss(predicted: Positions, target: Positions) -> Float[Tensor, ""]:
    """Mean squared position error [m^2] over frames, observed particles and the 3 coordinates.

    The paper's loss up to a constant factor. NaN in the target marks an unobserved coordinate: it counts for
    nothing and sends no gradient. 0 if nothing was observed.
    """
    squared, observed = _squared_error(predicted, target)
    return squared.sum() / observed.sum().clamp_min(1)


def relative_errors(
    predicted: Positions, target: Positions, unstressed: Positions, segments: SceneIndex, count: int
) -> Float[Tensor, " segments"]:
    """Squared position error of each segment, relative to how far stress moved it [-].

        |x - x_true|^2_s / (|x_free - x_true|^2_s + NEGLIGIBLE)

    A segment of an impact moves a thousand times as far as one of a body coming to rest: in square metres the first
    decides alone, here each says as much about the law. NaN in the target is treated as by position_loss.

    unstressed  positions x_free that the particles would have without stress [m]
    segments    the segment that each particle belongs to, (particles,)
    count       number of segments
    """
    error, _ = _squared_error(predicted, target)
    observations, scale = relative_scales(target, unstressed, segments, count)
    return _of_segments(error, segments, count) / observations / scale


def relative_scales(
    target: Positions, unstressed: Positions, segments: SceneIndex, count: int
) -> tuple[Float[Tensor, " segments"], Float[Tensor, " segments"]]:
    """Number of observed coordinates of each segment, and what their mean squared error is divided by [m^2]."""
    moved, observed = _squared_error(unstressed, target)
    observations = _of_segments(observed.to(moved.dtype), segments, count).clamp_min(1.0)
    return observations, (_of_segments(moved, segments, count) / observations).detach() + NEGLIGIBLE


def relative_units(
    target: Positions, unstressed: Positions, segments: SceneIndex, count: int
) -> Float[Tensor, " particles"]:
    """What position errors are multiplied with [1/m], so that their squares add up to relative_errors."""
    observations, scale = relative_scales(target, unstressed, segments, count)
    return (observations * scale).rsqrt()[segments]


def _of_segments(values: Tensor, segments: SceneIndex, count: int) -> Float[Tensor, " segments"]:
    return values.new_zeros(count).index_add(0, segments, values.sum((0, 1)))


def unstressed_positions(state: ParticleState, scenes: Scenes, time_step: float, steps: Sequence[int]) -> Positions:
    """Positions [m] after each of `steps` steps if no particle felt any stress or wall."""
    return torch.stack([fallen(state, scenes, time_step, [n] * scenes.scene_count).position for n in steps])


def _squared_error(predicted: Positions, target: Positions) -> tuple[Positions, Tensor]:
    """Squared error [m^2], 0 where the target was not observed, and where it was."""
    observed = ~torch.isnan(target)
    error = torch.where(observed, predicted - torch.where(observed, target, 0.0), 0.0)
    return error.square(), observed
