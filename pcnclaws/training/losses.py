"""What training minimises."""

import torch
from jaxtyping import Float
from torch import Tensor


def position_loss(
    predicted: Float[Tensor, "frames 3 particles"], target: Float[Tensor, "frames 3 particles"]
) -> Float[Tensor, ""]:
    """Mean squared position error [m^2] over frames, observed particles and the 3 coordinates.

    The paper's loss up to a constant factor. NaN in the target marks an unobserved coordinate: it counts for
    nothing and sends no gradient. 0 if nothing was observed.
    """
    observed = ~torch.isnan(target)
    error = torch.where(observed, predicted - torch.where(observed, target, 0.0), 0.0)
    return error.square().sum() / observed.sum().clamp_min(1)
