"""Learning rates along a cosine, one step an iteration, which a run may go on with for longer."""

import math

import torch
from torch.optim.lr_scheduler import CosineAnnealingLR


def cosine_schedule(optimiser: torch.optim.Optimizer, iterations: int, final: float = 0.0) -> CosineAnnealingLR:
    """From the optimiser's learning rates at the first iteration to `final` after the last one."""
    return CosineAnnealingLR(optimiser, T_max=iterations, eta_min=final)


def lengthen(schedule: CosineAnnealingLR, iterations: int) -> None:
    """Makes a schedule that was restored from a shorter run the one of the whole length, from where it is on."""
    if iterations == schedule.T_max:
        return
    schedule.T_max = iterations
    share = 0.5 * (1.0 + math.cos(math.pi * schedule.last_epoch / iterations))
    for group, first in zip(schedule.optimizer.param_groups, schedule.base_lrs, strict=True):
        group["lr"] = schedule.eta_min + share * (first - schedule.eta_min)
