"""The yardstick T, the time of one float32 2048 x 2048 matrix product, and timing beside it.

Machines differ and are shared; a time divided by T, measured in the same seconds on the same threads, says more.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch

SIZE = 2048


class Timing(NamedTuple):
    """Seconds of each call, and of the matrix products before, between and after the calls."""

    seconds: list[float]
    matmul: list[float]

    @property
    def in_matmuls(self) -> float:
        """The fastest call in units of the fastest matrix product."""
        return min(self.seconds) / min(self.matmul)


class Yardstick:
    """Measures T, and keeps every sample by the number of threads that it was measured with."""

    def __init__(self, device: torch.device, size: int = SIZE) -> None:
        generator = torch.Generator().manual_seed(0)
        self.device = device
        self.samples: dict[int, list[float]] = {}
        self._factor = torch.rand((size, size), generator=generator).to(device)
        self._is_warm = False

    def measure(self) -> float:
        """Seconds of one product with the present number of threads."""
        if not self._is_warm:  # the first product starts threads
            torch.mm(self._factor, self._factor)
            self._is_warm = True
        taken = seconds(lambda: torch.mm(self._factor, self._factor), self.device)
        self.samples.setdefault(torch.get_num_threads(), []).append(taken)
        return taken

    def summary(self) -> Mapping[str, Any]:
        """Fastest time and spread, with the present number of threads, as plain values."""
        samples = self.samples.get(torch.get_num_threads()) or [self.measure()]
        return {
            "matmul_2048_ms": 1e3 * min(samples),
            "median_ms": 1e3 * float(np.median(samples)),
            "slowest_ms": 1e3 * max(samples),
            "samples": len(samples),
        }


def interleaved(call: Callable[[], object], yardstick: Yardstick, samples: int, least: float = 0.0) -> Timing:
    """Times a call `samples` times, or for longer until it has been timed for `least` seconds.

    A matrix product goes before, between and after the calls. The first call, which starts threads, fills caches
    and compiles, is not timed.
    """
    call()
    taken, products = [], [yardstick.measure()]
    while len(taken) < samples or sum(taken) < least:
        taken.append(seconds(call, yardstick.device))
        products.append(yardstick.measure())
    return Timing(taken, products)


def cost_of(timing: Timing, particles: int, steps: int) -> dict[str, Any]:
    """Time of a step per 1000 particles: in ms with its spread, and in T/1000 (fastest over fastest)."""
    share = 1e3 / (particles * steps)
    return {
        "ms_per_1000": spread([1e3 * share * taken for taken in timing.seconds]),
        "matmul_ms": spread([1e3 * taken for taken in timing.matmul]),
        "cost": 1e3 * share * timing.in_matmuls,
        "samples": len(timing.seconds),
    }


def seconds(call: Callable[[], object], device: torch.device) -> float:
    """Wall time of a call, to its end on the device."""
    synchronise(device)
    began = time.perf_counter()
    call()
    synchronise(device)
    return time.perf_counter() - began


def synchronise(device: torch.device) -> None:
    """Waits until a GPU has done what it was given."""
    if device.type == "cuda":
        torch.cuda.synchronize(device)


def spread(samples: Sequence[float]) -> dict[str, float]:
    """Fastest, median and slowest of some times."""
    return {"min": min(samples), "median": float(np.median(samples)), "max": max(samples)}
