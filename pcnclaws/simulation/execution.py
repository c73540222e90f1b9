"""Execution settings of a simulation: precision, device, fast paths, progress."""

from collections.abc import Callable
from dataclasses import dataclass, field

import torch

from pcnclaws.simulation.fast_paths import Skips

# Called with the number of steps just done.
Progress = Callable[[int], None]


@dataclass(frozen=True)
class Execution:
    """How a simulation is computed, as one value that callers hand on.

    dtype     of the simulation and of what it records
    skips     fast paths, all of them by default
    progress  called with the number of steps just done
    """

    dtype: torch.dtype = torch.float32
    device: str | torch.device = "cpu"
    skips: Skips = field(default_factory=Skips)
    progress: Progress | None = None


# What a caller gets that asks for nothing else.
SINGLE_ON_CPU = Execution()
