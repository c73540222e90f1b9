"""What transfers between particles and grid keep of a vibration, at any time step, and what a step costs with them."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from rich.markup import escape
from rich.table import Table

from benchmarks.cases import Case, Prepared, laws_of
from benchmarks.charts import COLOURS, chart, decorate, save, table_of
from benchmarks.checks import names, numbers, whole
from benchmarks.context import BenchmarkContext
from benchmarks.verification.motion_bar import SOUND, SPEED, Bar
from benchmarks.verification.motion_scenes import array, steps_of
from benchmarks.yardstick import seconds, spread
from pcnclaws.mpm.transfer_orders import APIC, TRANSFERS
from pcnclaws.simulation.simulator import simulator_of

__all__ = ["draw", "run", "tables"]

WORK = ("forward", "gradient")
# A step with another transfer may cost this much more than with APIC.
AT_MOST = 1.5
EVERY = 2  # steps between frames


def run(options: Mapping[str, Any], context: BenchmarkContext) -> dict[str, Any]:
    """Amplitudes of a free bar, and times of a step.

    {"at_most", "bars": [{"transfer", "cfl", "periods", "kept", "rest_first", "rest_last"}],
    "costs": [{"transfer", "work", "ms", "ratio"}]}
    """
    chosen, levels = names(options, "transfers", TRANSFERS), numbers(options, "cfl", 0.0)
    bar, periods, long = Bar(whole(options, "cells")), whole(options, "periods"), whole(options, "long_periods")
    orders = [(cfl, periods) for cfl in levels]
    orders += [(cfl, long) for cfl in numbers({"long_cfl": [options["long_cfl"]]}, "long_cfl", 0.0)]
    bars = []
    for number, (transfer, (cfl, count)) in enumerate((one, order) for one in chosen for order in orders):
        context.advance(number, len(chosen) * len(orders), f"{transfer}, CFL {cfl:g}, {count} periods")
        bars.append(vibration(bar._replace(transfer=transfer), cfl, count))
    return {"at_most": AT_MOST, "bars": bars, "costs": _costs(chosen, options, context)}


def vibration(bar: Bar, cfl: float, periods: int) -> dict[str, Any]:
    """What is left of the first mode, and how much of the velocities is not part of it, relative to the start.

    kept        the largest share of the first mode in half a period about the last one
    rest_first  root mean square of the rest in the first period, at its largest
    rest_last   in the last one
    """
    body, along = bar.body()
    shape = bar.mode(along)
    steps, time_step = steps_of((periods + 0.25) * bar.period, cfl * bar.spacing / SOUND)
    steps -= steps % EVERY
    start = SPEED * math.cos(0.5 * bar.omega * time_step) * shape
    motion = bar.scene(start, body, time_step).simulate(steps, EVERY, dtype=torch.float64)
    velocity, time = array(motion.velocity) / SPEED, array(motion.time) / bar.period
    mode = velocity[:, :, 0] @ shape / (shape @ shape)
    velocity[:, :, 0] -= mode[:, None] * shape
    rest = np.sqrt(np.square(velocity).sum(2).mean(1))
    return {
        "transfer": bar.transfer,
        "cfl": cfl,
        "periods": periods,
        "kept": float(np.abs(mode[time > periods - 0.25]).max()),
        "rest_first": float(rest[time < 1.0].max()),
        "rest_last": float(rest[time > periods - 0.75].max()),
    }


def _costs(chosen: list[str], options: Mapping[str, Any], context: BenchmarkContext) -> list[dict[str, Any]]:
    """Times of a step in turns, forward, and forward and backward with the gradient of E, relative to APIC."""
    steps, samples, scenes = (whole(options, name) for name in ("steps", "samples", "scenes"))
    rows = []
    for work in WORK:
        calls: dict[str, Callable[[], object]] = {}
        for transfer in dict.fromkeys((APIC, *chosen)):
            prepared = Prepared(Case("elasticity", scenes=scenes, seed=context.seed), context.device, steps)
            settings = replace(prepared.case.settings, transfer=transfer)
            prepared.simulator = simulator_of(laws_of(prepared.case), settings).to(context.device)
            calls[transfer] = getattr(prepared, work)(steps)
            calls[transfer]()
        times: dict[str, list[float]] = {transfer: [] for transfer in calls}
        for sample in range(samples):
            context.advance(sample, samples, f"cost, {work}")
            for transfer in list(calls)[:: 1 if sample % 2 else -1]:
                times[transfer].append(1e3 / steps * seconds(calls[transfer], context.device))
        least = {transfer: min(taken) for transfer, taken in times.items()}
        rows += [
            {"transfer": one, "work": work, "ms": spread(times[one]), "ratio": least[one] / least[APIC]}
            for one in times
        ]
    context.advance(samples, samples, "done")
    return rows


def tables(document: Mapping[str, Any]) -> list[Table]:
    """What is kept, by time step, and what it costs."""
    rows = document["results"]["bars"]
    kept = table_of("a free bar", "transfer", "CFL number", "periods", "amplitude left")
    kept.add_column(escape("rest, first period"), justify="right")
    kept.add_column(escape("rest, last period"), justify="right")
    for row in rows:
        rest = (f"{row[name]:.4f}" for name in ("rest_first", "rest_last"))
        kept.add_row(row["transfer"], f"{row['cfl']:g}", str(row["periods"]), f"{row['kept']:.3f}", *rest)
    costs = table_of("cost of a step", "transfer")
    for header in ("work", "least [ms]", "over that of apic"):
        costs.add_column(escape(header), justify="right")
    for row in document["results"]["costs"]:
        costs.add_row(row["transfer"], row["work"], f"{row['ms']['min']:.3g}", f"{row['ratio']:.2f}")
    return [kept, costs]


def draw(document: Mapping[str, Any], folder: Path) -> list[Path]:
    """The amplitude that is left over the CFL number, a line for each transfer."""
    rows, short = document["results"]["bars"], document["options"]["periods"]
    figure, axis = chart()
    for number, transfer in enumerate(document["options"]["transfers"]):
        own = [row for row in rows if (row["transfer"], row["periods"]) == (transfer, short)]
        axis.plot(
            [row["cfl"] for row in own], [row["kept"] for row in own], "o-", color=COLOURS[number], label=transfer
        )
    axis.set_xscale("log")
    axis.set_xticks(document["options"]["cfl"], [f"{number:g}" for number in document["options"]["cfl"]])
    axis.minorticks_off()
    decorate(axis, "CFL number", f"amplitude left after {short} periods")
    axis.legend(frameon=False)
    return [save(figure, folder / f"{document['problem']}.png")]
