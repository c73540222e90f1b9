"""Bodies of several kinds at once: do they stay finite with bounded energy, by the analytic and a learned law?"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from rich.table import Table

from benchmarks.charts import COLOURS, chart, decorate, save, table_of
from benchmarks.checks import whole
from benchmarks.context import BenchmarkContext, Checkpointed
from pcnclaws.data.sampling import TEST_MOTIONS, DataSetPlan
from pcnclaws.errors import SimulationDiverged, UserError
from pcnclaws.evaluation.energy import potential_energy, scene_energy
from pcnclaws.geometry.shapes import spin_velocity
from pcnclaws.laws.analytic import Laws, analytic_laws
from pcnclaws.laws.materials import Material, material_named
from pcnclaws.laws.parameters import PLASTICINE_SHARE, SAND_SHARE
from pcnclaws.simulation.batch import batch_scenes
from pcnclaws.simulation.execution import Execution
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.simulation.scenes import SceneStart, restarted

EVERY, KEYFRAME_EVERY = 5, 10


def run(options: Mapping[str, Any], context: BenchmarkContext) -> dict[str, Any]:
    """Energies and errors of thrown cubes with other shares of plasticine and of sand.

    {"rows": [{"shares", "motion", "law", "finite", "energy", "growth", "mse"}]}: energy, kinetic, elastic and potential
    at the keyframes [J]; growth, its largest value over that of the start; mse [m^2] to the analytic law's motion
    """
    material, steps = material_named("unified"), whole(options, "steps")
    every_share = [_checked(pair) for pair in options["shares"]]
    laws = {"analytic": analytic_laws(material), "learned": context.laws(str(options["law"]), material)}
    key = {"options": {**options, "law": str(options["law"])}, "precision": "float32"}
    done = Checkpointed.load(context.folder, "between_kinds", key)
    orders = [(shares, motion) for shares in every_share for motion in range(len(TEST_MOTIONS))]
    rows = []
    for number, (shares, motion) in enumerate(orders):
        context.advance(number, len(orders), f"shares {shares[0]:g} and {shares[1]:g}, motion {motion}")

        def made(shares: Sequence[float] = shares, motion: int = motion) -> list[dict[str, Any]]:
            return _rows(_start(material, shares, motion), laws, FramePlan(steps, EVERY, KEYFRAME_EVERY), context)

        found = done.row(f"{shares} {motion}", made)
        rows += [{"shares": list(shares), "motion": motion, **row} for row in found]
    context.advance(len(orders), len(orders), "done")
    return {"rows": rows}


def tables(document: Mapping[str, Any]) -> list[Table]:
    """The largest energy and the error, a line for each pair of shares, worst motion of both laws."""
    names = ("plasticine", "sand", "analytic: energy / start", "learned: energy / start", "learned, MSE [m²]")
    table = table_of("bodies between kinds", *names)
    for shares, rows in _by_shares(document).items():
        growths = [_worst(rows, law, "growth") for law in ("analytic", "learned")]
        table.add_row(*(f"{share:g}" for share in shares), *growths, _worst(rows, "learned", "mse"))
    return [table]


def draw(document: Mapping[str, Any], folder: Path) -> list[Path]:
    """The energy over the steps of each body of the first motion, by both laws."""
    figure, axis = chart()
    for number, (shares, rows) in enumerate(_by_shares(document).items()):
        for row in rows:
            if row["motion"] == 0 and row["finite"]:
                energy = np.array(row["energy"])
                style = "-" if row["law"] == "analytic" else ":"
                label = f"plasticine {shares[0]:g}, sand {shares[1]:g}" if row["law"] == "analytic" else None
                steps = KEYFRAME_EVERY * np.arange(len(energy))
                axis.plot(steps, energy / energy[0], style, color=COLOURS[number % len(COLOURS)], label=label)
    decorate(axis, "step", "energy over that of the start (dotted: learned)")
    axis.legend(fontsize=7, frameon=False)
    return [save(figure, folder / f"{document['problem']}.png")]


def _by_shares(document: Mapping[str, Any]) -> dict[tuple[float, ...], list[dict[str, Any]]]:
    found: dict[tuple[float, ...], list[dict[str, Any]]] = {}
    for row in document["results"]["rows"]:
        found.setdefault(tuple(row["shares"]), []).append(row)
    return found


def _worst(rows: Sequence[Mapping[str, Any]], law: str, name: str) -> str:
    of_law = [row for row in rows if row["law"] == law]
    if not all(row["finite"] for row in of_law):
        return "diverged"
    return f"{max(row[name] for row in of_law):{'.1e' if name == 'mse' else '.4f'}}"


def _rows(
    start: SceneStart, laws: Mapping[str, Laws], plan: FramePlan, context: BenchmarkContext
) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = []
    true: SceneRecord | None = None
    for name, law in laws.items():
        row: dict[str, Any] = {"law": name, "finite": False, "energy": None, "growth": None, "mse": None}
        try:
            (record,) = simulate_records([start], law, plan, Execution(device=context.device))
        except SimulationDiverged:
            rows.append(row)
            continue
        true = true or record
        energy = _energies(start, record, laws["analytic"])
        mse = float(np.square(record.position - true.position).mean())
        rows.append(row | {"finite": True, "energy": energy, "growth": max(energy) / energy[0], "mse": mse})
    return rows


@torch.no_grad()
def _energies(start: SceneStart, record: SceneRecord, analytic: Laws) -> list[float]:
    """Kinetic, elastic and potential energy at the keyframes [J]."""
    keyframes = record.keyframes
    assert keyframes is not None  # noqa: S101
    found = []
    for row in range(len(keyframes.step)):
        batch = batch_scenes([restarted(start, keyframes, row)], torch.float64)
        state = (batch.state, batch.scenes)
        lively = scene_energy(*state, batch.parameters, analytic.elasticity, start.settings.grid_spacing)
        found.append(float(lively + potential_energy(*state, start.settings.floor)))
    return found


def _start(material: Material, shares: Sequence[float], motion: int) -> SceneStart:
    """The cube of the data sets in the middle of all ranges."""
    plan, thrown = DataSetPlan(material), TEST_MOTIONS[motion]
    position = plan.body.position
    velocity = spin_velocity(position, np.broadcast_to(thrown.velocity, position.shape), thrown.spin.tolist())
    values = material.defaults | dict(zip((PLASTICINE_SHARE.name, SAND_SHARE.name), shares, strict=True))
    name = f"between-{shares[0]:g}-{shares[1]:g}-{motion}"
    return SceneStart(name, material.name, plan.settings, values, position, velocity, plan.body.volume)


def _checked(pair: Any) -> tuple[float, float]:
    if len(pair) != 2 or not all(0.0 <= float(share) <= 1.0 for share in pair):
        raise UserError(f"problem.shares: {pair} is not accepted; accepted: pairs of numbers from 0 to 1")
    return float(pair[0]), float(pair[1])
