"""How the cost of a forward step goes with the number of particles, of scenes in the batch and of threads."""

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, NamedTuple

import torch

from benchmarks.cases import Case, Prepared
from benchmarks.checks import names, whole, wholes
from benchmarks.context import BenchmarkContext
from benchmarks.processes import peak_memory
from benchmarks.scaling_report import CURVES, draw, tables
from benchmarks.yardstick import cost_of, interleaved
from pcnclaws.compiled.backend import BACKENDS, using_backend

__all__ = ["draw", "run", "tables"]

MATERIAL = "elasticity"
# Particle-steps of a timed run, and of the steps before it.
TIMED, SETTLED = 800_000, 20_000_000
FEWEST_STEPS = 3
MEMORY_STEPS = 2
LEAST_SECONDS = 1.0
# Largest cost over the least of the sizes, smallest gain of two threads from 10^4 particles on, peak memory at 10^6.
BOUNDS = {"over_best": 2.0, "gain_of_two_threads": 1.5, "peak_mb": 6000.0}


class Row(NamedTuple):
    """One measurement to make, for one of the three curves."""

    curve: str
    backend: str
    case: Case
    threads: int
    most_steps: int

    @property
    def name(self) -> str:
        """In words, for the progress."""
        return f"{self.curve}: {self.case.particles} particles, {self.threads} thread(s), {self.backend}"

    def steps(self, particle_steps: int) -> int:
        """Steps of about so many particle-steps."""
        return min(max(particle_steps // self.case.particles, FEWEST_STEPS), self.most_steps)


def run(options: Mapping[str, Any], context: BenchmarkContext) -> dict[str, Any]:
    """Costs over particles, scenes and threads.

    {"precision", "bounds", "particles": [...], "scenes": [...], "threads": [...]}, rows of {"backend", "particles",
    "scenes", "threads", "ms_per_1000", "matmul_ms", "cost", ..., "memory"}
    """
    rows = _rows(options, context)
    samples = whole(options, "samples")
    results: dict[str, Any] = {"precision": "float32", "bounds": BOUNDS, **{curve: [] for curve in CURVES}}
    with_memory = options["memory"] and context.device.type == "cpu"
    for number, row in enumerate(rows):
        context.advance(number, len(rows), row.name)
        measured = _measured(row, context, samples)
        if with_memory and row.curve == "particles":
            measured["memory"] = peak_memory(row.case, "forward", MEMORY_STEPS, row.backend)
        results[row.curve].append(measured)
    context.advance(len(rows), len(rows), "done")
    return results


def _rows(options: Mapping[str, Any], context: BenchmarkContext) -> list[Row]:
    """What is to be measured; UserError for a wrong option."""
    edges = wholes(options, "edges", least=4, most=200)
    thread_edges = wholes(options, "thread_edges", least=4, most=200)
    threads = list(dict.fromkeys(count or os.cpu_count() or 1 for count in wholes(options, "threads", least=0)))
    scenes = wholes(options, "scenes")
    steps, seed, here = whole(options, "steps"), context.seed, torch.get_num_threads()
    rows = []
    for backend in names(options, "backends", BACKENDS):
        rows += [Row("particles", backend, _body(edge, seed), here, steps) for edge in edges]
        rows += [Row("scenes", backend, Case(MATERIAL, scenes=count, seed=seed), here, steps) for count in scenes]
        rows += [Row("threads", backend, _body(edge, seed), count, steps) for edge in thread_edges for count in threads]
    return rows


def _body(edge: int, seed: int) -> Case:
    """A body with 8 particles a cell."""
    return Case(MATERIAL, particles_per_edge=edge, grid_nodes=edge, side=0.5 * (edge - 1) / edge, seed=seed)


def _measured(row: Row, context: BenchmarkContext, samples: int) -> dict[str, Any]:
    count = row.case.particles
    steps = row.steps(TIMED)
    with using_backend(row.backend), _threads(row.threads):
        prepared = Prepared(row.case, context.device, row.steps(SETTLED))
        least = LEAST_SECONDS if samples > 1 else 0.0
        timing = interleaved(prepared.forward(steps), context.yardstick, samples, least)
    return {
        "backend": row.backend,
        "particles": count,
        "scenes": row.case.scenes,
        "grid_nodes": row.case.grid_nodes,
        "threads": row.threads,
        "steps": steps,
        **cost_of(timing, count, steps),
    }


@contextmanager
def _threads(count: int) -> Iterator[None]:
    """That many CPU threads for the length of a `with` block."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)
