"""Training in several processes: time, agreement with one process, and what a plan for more of them rests on.

A plan for many GPUs needs the memory of a gradient, the time to add gradients up, and the sizes of files, too. What a
GPU does in a step is in the results of problem=step_cost.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks.cases import Case
from benchmarks.checks import whole, wholes
from benchmarks.context import BenchmarkContext
from benchmarks.data_parallel_report import draw, tables
from benchmarks.processes import peak_memory
from pcnclaws.data.hdf5 import write_scenes
from pcnclaws.data.sampling import DataSetPlan, planned_scenes
from pcnclaws.geometry.shapes import particles
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.materials import Material, material_named
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.training.processes import beside
from pcnclaws.training.weights import read_weights

__all__ = ["draw", "run", "tables"]

STEPS, SEGMENT_LENGTH, FRAME_EVERY = 200, 20, 5


def run(options: Mapping[str, Any], context: BenchmarkContext) -> dict[str, Any]:
    """Trainings of one data set in each number of processes, with as many segments a batch and with as many a process.

    {"rows": [{"processes", "segments", "iterations", "seconds", "ms_per_iteration", "load", "weights", "difference"}],
    "reduce": {"processes", "numbers", "ms"}, "memory": [{"particles", "steps", "above_mb"}], "file": {...}}
    """
    material = material_named(options["material"], "problem.material")
    counts, segments = wholes(options, "processes"), whole(options, "segments")
    iterations, edge = whole(options, "iterations"), whole(options, "particles_per_edge", least=2)
    edges, scenes = wholes(options, "memory_edges", least=2), whole(options, "scenes", least=2)
    orders = [(count, size) for count in counts for size in sorted({segments, segments * count})]
    total, rows = len(orders) + len(edges) + 1, []
    context.advance(0, total, "making data")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        records = _records(material, edge, scenes, context.seed)
        write_scenes(folder / "scenes.h5", records)
        for number, (count, size) in enumerate(orders):
            context.advance(number, total, f"{count} processes, {size} segments a batch")
            context.yardstick.measure()
            rows.append(_trained(folder, material, (count, size, iterations), context.seed))
        sizes = _sizes(folder, records[0])
    context.advance(len(orders), total, "adding up gradients")
    reduced = {
        "processes": max(counts),
        "numbers": rows[0]["weights"],
        "ms": _reduction(max(counts), rows[0]["weights"]),
    }
    memory = []
    for number, one in enumerate(edges):
        context.advance(len(orders) + 1 + number, total, f"memory of {one**3} particles")
        case = Case(material.name, "neural", particles_per_edge=one, grid_nodes=2 * one, seed=context.seed)
        found = peak_memory(case, "gradient", SEGMENT_LENGTH, "auto") or {"above_mb": None}
        memory.append({"particles": one**3, "steps": SEGMENT_LENGTH, "above_mb": found["above_mb"]})
    context.advance(total, total, "done")
    return {"material": material.name, "rows": rows, "reduce": reduced, "memory": memory, "file": sizes}


def _records(material: Material, edge: int, scenes: int, seed: int) -> list[SceneRecord]:
    """Analytic motions with restart states; the last one is for the checks."""
    body = particles(particles_per_edge=edge)
    plan = DataSetPlan(material, body=body, keyframe_every=SEGMENT_LENGTH, train_scenes=scenes, seed=seed)
    starts = planned_scenes(plan)["train"]
    return simulate_records(starts, analytic_laws(material), FramePlan(STEPS, FRAME_EVERY, SEGMENT_LENGTH))


def _trained(folder: Path, material: Material, order: tuple[int, int, int], seed: int) -> dict[str, Any]:
    """One training by its command; its weights beside those of one process with the same batches."""
    count, segments, iterations = order
    run = folder / f"run_{count}_{segments}"
    options = {
        "material": material.name,
        "data.trajectories": folder / "scenes.h5",
        "training.batch_segments": segments,
        "training.iterations": iterations,
        "training.check_every": iterations,
        "trainer.devices": count,
        "threads": count,
        "picture": False,
        "seed": seed,
        "output": run,
    }
    words = [f"{name}={value}" for name, value in options.items()]
    began, load = time.monotonic(), os.getloadavg()[0]
    # our own module with our own arguments, no shell
    subprocess.run([sys.executable, "-m", "pcnclaws.train", *words], check=True, stdout=subprocess.DEVNULL)  # noqa: S603
    whole_seconds = time.monotonic() - began
    seconds = float(json.loads((run / "metrics.json").read_text())["training"]["training_seconds"])
    weights, alone = _weights(run), folder / f"run_1_{segments}"
    difference = float(np.abs(weights - _weights(alone)).max()) if count > 1 and alone.exists() else None
    return {
        "processes": count,
        "segments": segments,
        "iterations": iterations,
        "seconds": seconds,
        "command_seconds": whole_seconds,
        "ms_per_iteration": 1e3 * seconds / iterations,
        "load": load,
        "weights": len(weights),
        "difference": difference,
    }


def _weights(run: Path) -> np.ndarray:
    return torch.cat([one.flatten() for one in read_weights(run / "weights.safetensors")[0].values()]).numpy()


def _reduction(count: int, numbers: int, repeats: int = 50) -> float | None:
    """Median time to add up as many numbers over gloo processes of this machine [ms]; None for one process."""
    if count == 1:
        return None
    with beside(count, reduce_repeatedly, numbers, repeats):
        return 1e3 * float(np.median(reduce_repeatedly(numbers, repeats)))


def reduce_repeatedly(numbers: int, repeats: int) -> list[float]:
    """Seconds of each of several all-reductions among the processes of this environment."""
    rank, size = int(os.environ["LOCAL_RANK"]), int(os.environ["WORLD_SIZE"])
    torch.distributed.init_process_group("gloo", rank=rank, world_size=size)
    values, seconds = torch.ones(numbers), []
    for _ in range(repeats):
        began = time.perf_counter()
        torch.distributed.all_reduce(values)
        values.fill_(1.0)
        seconds.append(time.perf_counter() - began)
    return seconds


def _sizes(folder: Path, record: SceneRecord) -> dict[str, float]:
    """Bytes of a trajectory file a particle: of a frame, and of a restart state."""
    frames, count, _ = record.position.shape
    write_scenes(folder / "bare.h5", [replace(record, keyframes=None)])
    write_scenes(folder / "full.h5", [record])
    bytes_of = {name: (folder / f"{name}.h5").stat().st_size for name in ("bare", "full")}
    states = STEPS // SEGMENT_LENGTH + 1
    return {
        "frame": bytes_of["bare"] / frames / count,
        "restart_state": (bytes_of["full"] - bytes_of["bare"]) / states / count,
    }
