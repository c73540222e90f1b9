"""What each switch of `simulation.skip.*` gains on a scene where it applies, and how far the result moves."""

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from benchmarks.checks import names, whole
from benchmarks.context import BenchmarkContext
from benchmarks.processes import peak_memory_of_trial
from benchmarks.skip_trials import TRIALS, run_trial, switched_off, trial_steps
from benchmarks.skips_report import draw, tables
from benchmarks.yardstick import seconds, spread
from pcnclaws.compiled.backend import BACKENDS, using_backend
from pcnclaws.simulation.fast_paths import Skips

__all__ = ["draw", "run", "tables"]


def run(options: Mapping[str, Any], context: BenchmarkContext) -> dict[str, Any]:
    """Times with the switch on and off in turns, their ratio, the largest difference, and peak memory.

    {"precision", "rows": [{"switch", "scene", "backend", "on_ms", "off_ms", "gain", "difference",
    "relative_difference", "memory": {"on", "off"} or None, ...}]}; times are of one step
    """
    chosen = names(options, "switches", TRIALS)
    backends, samples = names(options, "backends", BACKENDS), whole(options, "samples")
    edge, steps = whole(options, "particles_per_edge", least=4), whole(options, "steps")
    orders = [(name, backend) for backend in backends for name in chosen]
    rows = []
    for number, (name, backend) in enumerate(orders):
        context.advance(number, len(orders), f"{name}, {backend}")
        length = trial_steps(name, steps)
        with using_backend(backend):
            row = _measured(name, edge, length, samples, context)
        if options["memory"] and TRIALS[name].memory and context.device.type == "cpu":
            row["memory"] = {key: peak_memory_of_trial(name, key, edge, length, backend) for key in ("on", "off")}
        rows.append({"switch": name, "scene": TRIALS[name].words, "backend": backend, "steps": length, **row})
    context.advance(len(orders), len(orders), "done")
    return {"precision": "float32", "rows": rows}


def _measured(name: str, edge: int, steps: int, samples: int, context: BenchmarkContext) -> dict[str, Any]:
    on = partial(run_trial, name, Skips(), edge, steps, context.device)
    off = partial(run_trial, name, switched_off(name), edge, steps, context.device)
    with_switch, without = on(), off()
    difference = float(np.abs(with_switch - without).max())
    times: dict[str, list[float]] = {"on": [], "off": []}
    products = [context.yardstick.measure()]
    for _ in range(samples):
        for key, work in (("on", on), ("off", off)):
            times[key].append(1e3 / steps * seconds(work, context.device))
        products.append(context.yardstick.measure())
    return {
        "particles": int(with_switch.shape[-2]),
        "on_ms": spread(times["on"]),
        "off_ms": spread(times["off"]),
        "gain": min(times["off"]) / min(times["on"]),
        "matmul_ms": spread([1e3 * product for product in products]),
        "difference": difference,
        "relative_difference": difference / float(np.abs(without).max()),
        "memory": None,
    }
