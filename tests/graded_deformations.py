"""Deformation gradients of every scale and grading, as bodies with a symmetry make them, and far beyond."""

import torch
from bodies import seeded
from torch import Tensor

from pcnclaws.tensors.graded_axes import principal_axes

# decimal exponents of single precision, from its smallest number to squares that it still holds
LEAST, MOST = -45.0, 18.0
STRETCHES = (1.0, 1.0 + 1e-7, 1.0 - 6e-8, 0.5, 2.0, 0.05, 20.0)
FAMILIES = ("nearly none", "stretched", "sheared", "scaled", "graded", "any")


def graded(family: str, count: int, seed: int = 0) -> Tensor:
    """Deformation gradients with det F > 0 and entries that single precision holds, (3, 3, at most count), float64."""
    generator = seeded(seed)

    def uniform(low: float, high: float, *shape: int) -> Tensor:
        return low + (high - low) * torch.rand(*shape, generator=generator, dtype=torch.float64)

    def powers(low: float, high: float, *shape: int) -> Tensor:
        """Of both signs, a third of them 0."""
        sign = torch.randint(-1, 2, shape, generator=generator)
        return sign * 10.0 ** uniform(low, high, *shape)

    identity = torch.eye(3, dtype=torch.float64)
    if family == "nearly none":
        f = identity + (1.0 - identity) * powers(LEAST, -1.0, count, 3, 3)
    elif family == "stretched":
        picked = torch.tensor(STRETCHES, dtype=torch.float64)
        stretches = picked[torch.randint(len(STRETCHES), (count, 3), generator=generator)]
        f = torch.diag_embed(stretches) + (1.0 - identity) * powers(LEAST, -2.0, count, 3, 3)
    elif family == "sheared":
        f = identity + powers(LEAST, MOST, count, 3, 3).triu(1)
    elif family == "scaled":
        scale = 10.0 ** uniform(LEAST, MOST, count, 1, 1)
        f = scale * (identity + (1.0 - identity) * powers(LEAST, -1.0, count, 3, 3))
    elif family == "graded":
        diagonal = torch.diag_embed(10.0 ** uniform(-3.0, 3.0, count, 3))
        f = diagonal + (1.0 - identity) * powers(LEAST, -4.0, count, 3, 3)
    else:
        f = powers(LEAST, MOST, count, 3, 3)
    f = f.float().double()
    return f[principal_axes(f)[2]].permute(1, 2, 0).contiguous()
