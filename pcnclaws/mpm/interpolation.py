"""Trilinear interpolation of samples on a grid of nodes, with its gradient."""

import torch
from jaxtyping import Float
from torch import Tensor

from pcnclaws.tensors.tensor_types import Vectors


def trilinear(samples: Float[Tensor, "x y z"], place: Vectors) -> tuple[Float[Tensor, " points"], Vectors]:
    """Value and gradient, for each cell, at places within the grid, (points,) and (3, points).

    place  in cells from the first node, (3, points)
    """
    counts = torch.tensor(samples.shape, device=place.device)[:, None]
    cell = torch.minimum(place.detach().floor().long().clamp_min(0), counts - 2)
    u, v, w = place - cell
    strides = (samples.shape[1] * samples.shape[2], samples.shape[2], 1)
    first = cell[0] * strides[0] + cell[1] * strides[1] + cell[2]
    offsets = [i * strides[0] + j * strides[1] + k for i in (0, 1) for j in (0, 1) for k in (0, 1)]
    numbers = first[None] + torch.tensor(offsets, device=place.device)[:, None]
    corners = samples.flatten()[numbers].to(place.dtype).unflatten(0, (2, 2, 2))
    along_x = corners[1] - corners[0]
    at_x = corners[0] + u * along_x
    along_y = at_x[1] - at_x[0]
    at_y = at_x[0] + v * along_y
    along_z = at_y[1] - at_y[0]
    slope_x = _bilinear(along_x, v, w)
    slope_y = along_y[0] + w * (along_y[1] - along_y[0])
    return at_y[0] + w * along_z, torch.stack((slope_x, slope_y, along_z))


def _bilinear(corners: Float[Tensor, "2 2 points"], v: Tensor, w: Tensor) -> Tensor:
    at_y = corners[0] + v * (corners[1] - corners[0])
    return at_y[0] + w * (at_y[1] - at_y[0])
