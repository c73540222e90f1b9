"""What one step costs per 1000 particles, in milliseconds and in thousandths of the yardstick T.

A  forward, analytic elasticity
B  forward and backward, analytic elasticity, gradient of E
C  forward, two neural laws
D  forward and backward, two neural laws, gradient of all weights
"""

import tempfile
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

from benchmarks.cases import Case, Prepared
from benchmarks.checks import names, whole, wholes
from benchmarks.context import BenchmarkContext
from benchmarks.processes import peak_memory, seconds_of_process
from benchmarks.step_cost_report import draw, tables
from benchmarks.yardstick import cost_of, interleaved
from pcnclaws.compiled.backend import BACKENDS, using_backend

__all__ = ["draw", "run", "tables"]


class Kind(NamedTuple):
    """One line of the table: the work of a step, and what it may cost [T/1000 per 1000 particles].

    work          method of Prepared
    target, aim   cost with several scenes in the batch: at most, and the aim
    """

    words: str
    material: str
    laws: str
    work: str
    target: float
    aim: float


KINDS = {
    "A": Kind("forward, analytic", "elasticity", "analytic", "forward", 2.8, 1.5),
    "B": Kind("forward + backward, analytic", "elasticity", "analytic", "gradient", 10.0, 6.0),
    "C": Kind("forward, neural", "sand", "neural", "forward", 5.5, 4.0),
    "D": Kind("forward + backward, neural", "sand", "neural", "gradient", 15.0, 10.0),
}
# One scene may cost this much more per particle than several scenes in the batch.
ONE_SCENE_FACTOR = 1.6
MEMORY_TARGET_MB = 250.0
COMPILATION_TARGET = 60.0  # [s]
# Steps before the timed ones: the bodies are deep in contact then.
SETTLE = 100
SETTLE_LARGE = 40
# A timed run has about as many particle-steps as one of 8 scenes, but not fewer steps than this.
FEWEST_STEPS = 5
LARGEST_BATCH = 8000
# Seconds of timed runs that a row gets at least.
LEAST_SECONDS = 2.0
# Cost of other engines [T/1000 per 1000 particles and step]: forward and backward through 100 steps in B and D.
REFERENCES = {
    "note": "in units of T/1000, measured on another machine, one thread, not in this run",
    "NCLaws engine (Warp)": {"A": 8.9, "B": 50.0, "C": 27.0, "D": 95.0, "A 8000": 6.4, "A 64000": 5.9},
    "warp-mpm": {"A": 9.5},
    "MPM-PyTorch": {"A": 50.0, "B": 145.0, "A 8000": 39.0, "A 64000": 39.0},
    "DiffTaichi (neo-Hookean)": {"A": 9.3, "B": 36.0, "A 8000": 6.6, "A 64000": 6.6},
    "Taichi mpm3d (volume-only law)": {"A 8000": 6.8, "A 64000": 6.8},
}


class Row(NamedTuple):
    """One measurement to make."""

    kind: str
    backend: str
    case: Case
    steps: int
    settle: int

    @property
    def name(self) -> str:
        """In words, for the progress."""
        return f"{self.kind} {self.case.particles} particles, {self.backend}"


def run(options: Mapping[str, Any], context: BenchmarkContext) -> dict[str, Any]:
    """Costs of all rows, the peak memory of D, and how long the first call of a process takes.

    {"precision", "rows": [{"kind", "backend", "scenes", "particles", "cost", ...}], "memory": [...],
    "first_call": [...], "references"}
    """
    rows = _rows(options, context.seed)
    backends = names(options, "backends", BACKENDS)
    samples, memory_steps = whole(options, "samples"), whole(options, "memory_steps", least=0)
    work: list[tuple[str, str, Callable[[], dict[str, Any]]]] = []
    work += [("rows", row.name, partial(_measured, row, context, samples)) for row in rows]
    if memory_steps and context.device.type == "cpu":
        work += [("memory", f"memory of D, {name}", partial(_memory, name, memory_steps, context)) for name in backends]
    if options["first_call"] and context.device.type == "cpu":
        work += [("first_call", f"first call, {name}", partial(_first_call, name, context)) for name in backends]
    results: dict[str, Any] = {"precision": "float32", "rows": [], "memory": [], "first_call": []}
    for number, (part, words, measure) in enumerate(work):
        context.advance(number, len(work), words)
        results[part].append(measure())
    context.advance(len(work), len(work), "done")
    return results | {"references": REFERENCES}


def _rows(options: Mapping[str, Any], seed: int) -> list[Row]:
    """What is to be measured; UserError for a wrong option."""
    steps = whole(options, "steps")
    bodies = wholes(options, "bodies", least=4, most=100)
    rows = []
    for backend in names(options, "backends", BACKENDS):
        for scenes in wholes(options, "scenes"):
            for name, kind in KINDS.items():
                rows.append(Row(name, backend, Case(kind.material, kind.laws, scenes, seed=seed), steps, SETTLE))
        for edge in bodies:
            # the paper has 10 particles along the edge at 20 nodes
            case = Case("elasticity", particles_per_edge=edge, grid_nodes=2 * edge, seed=seed)
            fewer = max(FEWEST_STEPS, steps * LARGEST_BATCH // case.particles)
            rows.append(Row("A", backend, case, min(steps, fewer), SETTLE_LARGE))
    return rows


def _measured(row: Row, context: BenchmarkContext, samples: int) -> dict[str, Any]:
    kind = KINDS[row.kind]
    with using_backend(row.backend):
        prepared = Prepared(row.case, context.device, min(row.settle, row.steps))
        work: Callable[[], object] = getattr(prepared, kind.work)(row.steps)
        timing = interleaved(work, context.yardstick, samples, LEAST_SECONDS if samples > 1 else 0.0)
    return {
        "kind": row.kind,
        "words": kind.words,
        "backend": row.backend,
        "scenes": row.case.scenes,
        "particles": row.case.particles,
        "grid_nodes": row.case.grid_nodes,
        "steps": row.steps,
        **cost_of(timing, row.case.particles, row.steps),
        **_bounds(row, kind),
    }


def _bounds(row: Row, kind: Kind) -> dict[str, float]:
    """What the row may cost and the aim. A small batch has more to carry per particle, a large body has not."""
    if row.case.particles >= LARGEST_BATCH:
        return {"at_most": kind.target, "aim": kind.aim}
    return {"at_most": ONE_SCENE_FACTOR * kind.target, "aim": ONE_SCENE_FACTOR * kind.aim}


def _memory(backend: str, steps: int, context: BenchmarkContext) -> dict[str, Any]:
    """Peak memory of D for one scene."""
    kind = KINDS["D"]
    found = peak_memory(Case(kind.material, kind.laws, seed=context.seed), kind.work, steps, backend)
    return {"kind": "D", "backend": backend, "scenes": 1, "steps": steps, "at_most_mb": MEMORY_TARGET_MB, "peak": found}


def _first_call(backend: str, context: BenchmarkContext) -> dict[str, Any]:
    """Seconds to the end of the first step after the imports, without and with what an earlier process has compiled."""
    kind = KINDS["D"]
    case = Case(kind.material, kind.laws, seed=context.seed)
    with tempfile.TemporaryDirectory() as cache:
        cold, warm = (seconds_of_process(case, kind.work, 1, backend, cache) for _ in range(2))
    return {"backend": backend, "cold_seconds": cold, "warm_seconds": warm, "at_most_seconds": COMPILATION_TARGET}
