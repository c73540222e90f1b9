"""Array layouts: particle-first arrays of files and tensors of users, component-first tensors of the simulator.

The only place where one becomes the other.
"""

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor


def particles_last(field: Float[Tensor, "particles *components"]) -> Float[Tensor, "*components particles"]:
    """A particle-first field, component-first, differentiable."""
    return field.movedim(0, -1).contiguous()


def particles_first(field: Tensor, frames: bool = False) -> Tensor:
    """A component-first field, particle-first, differentiable; frames: its first dimension is that of frames."""
    return field.movedim(-1, int(frames))


def vectors_first(vectors: np.ndarray) -> np.ndarray:
    """(..., particles, 3) to (..., 3, particles)."""
    return np.ascontiguousarray(np.swapaxes(vectors, -1, -2))


def vectors_last(vectors: Float[Tensor, "*frames 3 particles"]) -> np.ndarray:
    """(..., 3, particles) to (..., particles, 3), in the precision of the field."""
    return np.ascontiguousarray(np.swapaxes(vectors.detach().cpu().numpy(), -1, -2))


def matrices_first(matrices: Float[np.ndarray, "particles 3 3"]) -> Float[np.ndarray, "3 3 particles"]:
    """(particles, 3, 3) to (3, 3, particles)."""
    return np.ascontiguousarray(np.moveaxis(matrices, 0, -1))


def matrices_last(matrices: Float[Tensor, "*frames 3 3 particles"]) -> np.ndarray:
    """(..., 3, 3, particles) to (..., particles, 3, 3), in the precision of the field."""
    return np.ascontiguousarray(np.moveaxis(matrices.detach().cpu().numpy(), -1, -3))


def split_vectors(vectors: Float[Tensor, "frames 3 particles"], counts: Sequence[int]) -> list[np.ndarray]:
    """A field of a batch by scenes, each (frames, particles, 3), in the precision of the field.

    counts  SceneBatch.particle_counts
    """
    return [vectors_last(part) for part in vectors.detach().cpu().split(list(counts), dim=-1)]


def split_matrices(matrices: Float[Tensor, "frames 3 3 particles"], counts: Sequence[int]) -> list[np.ndarray]:
    """A field of a batch by scenes, each (frames, particles, 3, 3), in the precision of the field."""
    return [matrices_last(part) for part in matrices.detach().cpu().split(list(counts), dim=-1)]


def join_positions(
    positions: Sequence[np.ndarray], dtype: torch.dtype = torch.float32, device: str | torch.device = "cpu"
) -> Float[Tensor, "frames 3 particles"]:
    """Positions of scenes, each (frames, particles, 3), as one field of their batch."""
    return torch.tensor(vectors_first(np.concatenate(positions, axis=1)), dtype=dtype, device=device)
