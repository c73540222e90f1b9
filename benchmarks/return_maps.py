"""Floors of plastic forms: networks fitted to the true return map itself, and the motions that they then predict."""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import torch
from rich.table import Table
from torch import Tensor

from benchmarks.charts import COLOURS, chart, decorate, save, table_of
from benchmarks.checks import names, whole
from benchmarks.context import BenchmarkContext, Checkpointed
from benchmarks.foreign_materials import FOREIGN
from benchmarks.laws_from_motions import recorded_motions
from pcnclaws.commands.models import build_model
from pcnclaws.data.sampling import draw_parameters
from pcnclaws.errors import SimulationDiverged
from pcnclaws.evaluation.tasks import evaluate_records
from pcnclaws.laws.analytic import Laws, analytic_laws
from pcnclaws.laws.base import Plasticity
from pcnclaws.laws.materials import MATERIALS, Material
from pcnclaws.laws.neural_convex import ConvexPlasticNet
from pcnclaws.laws.operations import deviator
from pcnclaws.laws.registry import register
from pcnclaws.simulation.law_simulator import LawSimulator

PLASTIC = tuple(name for name, material in FOREIGN.items() if material.plastic is not None)
# Sizes of the strains that are returned to the surface, and how far beyond it trial strains are, in shares of them.
SMALLEST, LARGEST, BEYOND = 3e-4, 6e-2, 0.2
BINS = 6  # of the Lode angle


def run(options: Mapping[str, Any], context: BenchmarkContext) -> dict[str, Any]:
    """For each material and model, what of the return map the form cannot say, and the error of the motions with it.

    {"rows": [{"material", "model", "residual", "by_lode", "unseen", "seconds"}]}; residuals are root mean squares of
    |h' - h'_true| over |h|, by_lode of trial strains from uniaxial extension to compression; MSE [m^2]
    """
    materials = [FOREIGN[name] for name in names(options, "materials", PLASTIC)]
    models, samples, iterations = list(options["models"]), whole(options, "samples"), whole(options, "iterations")
    orders = [(material, model) for material in materials for model in models]
    key = {name: value for name, value in options.items() if name not in ("materials", "models")}
    done = Checkpointed.load(context.folder, "return_maps", {"options": key, "seed": context.seed})
    rows = []
    for number, (material, model) in enumerate(orders):
        context.advance(number, len(orders), f"{material.name} by {model}")

        def made(material: Material = material, model: str = model) -> dict[str, Any]:
            if material.name not in MATERIALS:
                register(material)
            began = time.monotonic()
            laws = build_model(material, {"name": model}).laws
            assert laws is not None  # noqa: S101
            found = _fitted(material, laws, samples, iterations, context.seed)
            return {**found, "unseen": _error(material, laws, options, context), "seconds": time.monotonic() - began}

        rows.append({"material": material.name, "model": model, **done.row(f"{material.name}, {model}", made)})
    context.advance(len(orders), len(orders), "done")
    return {"rows": rows}


def _error(material: Material, laws: Laws, options: Mapping[str, Any], context: BenchmarkContext) -> float | None:
    """Of the test motions, with the fitted plastic law beside the true elastic one [m^2]."""
    motions = recorded_motions(material, 1, whole(options, "steps"), context)["test"]
    simulator = LawSimulator(Laws(analytic_laws(material).elasticity, laws.plasticity))
    try:
        errors = [one.mse for one in evaluate_records(motions, simulator)]
    except SimulationDiverged:
        return None
    return sum(errors) / len(errors)


def _fitted(material: Material, laws: Laws, samples: int, iterations: int, seed: int) -> dict[str, Any]:
    """Fits the plastic law to the true one by Adam, and what is left on trial strains that it has not seen."""
    torch.manual_seed(seed)
    learned, true = laws.plasticity, analytic_laws(material).plasticity
    assert learned is not None  # noqa: S101
    assert true is not None  # noqa: S101
    optimiser = torch.optim.Adam(learned.parameters(), lr=5e-3)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, iterations)
    generator = torch.Generator().manual_seed(seed)
    bodies = draw_parameters(material, 256, (seed, 7))
    if isinstance(learned, ConvexPlasticNet):
        _begin(learned, lambda: _residuals(learned, true, bodies, samples, torch.Generator().manual_seed(seed))[0])
    for _ in range(iterations):
        residual, _ = _residuals(learned, true, bodies, samples, generator)
        optimiser.zero_grad()
        (1e4 * residual.square().mean()).backward()
        torch.nn.utils.clip_grad_norm_(learned.parameters(), 10.0)
        optimiser.step()
        schedule.step()
    with torch.no_grad():
        residual, lode = _residuals(learned, true, bodies, 16 * samples, generator)
    bins = ((lode + 1.0) * 0.5 * BINS).long().clamp(0, BINS - 1)
    flows = ~torch.isnan(lode)
    by_lode = [_root_mean_square(residual[flows & (bins == k)]) for k in range(BINS)]
    return {"residual": _root_mean_square(residual[flows]), "by_lode": by_lode}


def _begin(learned: ConvexPlasticNet, residuals: Callable[[], Tensor]) -> None:
    """The law's alternative with the least residual: a bound on compression that nothing reaches has no gradient."""
    found = []
    with torch.no_grad():
        for weight in learned.alternatives():
            learned.amounts.weight.copy_(weight)
            found.append((float(residuals().square().mean()), weight))
        learned.amounts.weight.copy_(min(found, key=lambda one: one[0])[1])


def _residuals(
    learned: Plasticity, true: Plasticity, bodies: Sequence[Mapping[str, float]], count: int, generator: torch.Generator
) -> tuple[Tensor, Tensor]:
    """|h' - h'_true| over |h|, and the sine of three times the Lode angle of h, NaN where nothing flows."""
    chosen = torch.randint(len(bodies), (count,), generator=generator).tolist()
    parameters = {name: torch.tensor([bodies[k][name] for k in chosen]) for name in bodies[0]}
    true_map = true.response(parameters)
    with torch.no_grad():
        h = torch.randn(3, count, generator=generator, dtype=torch.float64)
        size = torch.rand(count, generator=generator, dtype=torch.float64) * math.log(LARGEST / SMALLEST)
        admissible = true_map(h / h.norm(dim=0) * SMALLEST * size.exp())
        aside = torch.randn(3, count, generator=generator, dtype=torch.float64)
        beyond = BEYOND * torch.rand(count, generator=generator, dtype=torch.float64)
        trial = admissible + beyond * (admissible.norm(dim=0) + SMALLEST) * aside
        wanted = true_map(trial)
        dev = torch.stack(deviator(trial.unbind(0)))
        lode = 3.0 * 6.0**0.5 * dev.prod(0) / dev.norm(dim=0).clamp_min(1e-12) ** 3
        lode = torch.where((wanted - trial).abs().amax(0) > 1e-9, lode, torch.nan)
    return (learned.response(parameters)(trial) - wanted).norm(dim=0) / (trial.norm(dim=0) + SMALLEST), lode


def _root_mean_square(values: Tensor) -> float | None:
    return float(values.square().mean().sqrt()) if len(values) else None


def tables(document: Mapping[str, Any]) -> list[Table]:
    """The residuals and errors, a line a fit."""
    table = table_of("fits to the true return map", "", "model", "residual", "by Lode angle", "unseen, MSE [m²]")
    for row in document["results"]["rows"]:
        error = "diverged" if row["unseen"] is None else f"{row['unseen']:.1e}"
        by_lode = " ".join("-" if one is None else f"{one:.1e}" for one in row["by_lode"])
        table.add_row(row["material"], row["model"], f"{row['residual']:.1e}", by_lode, error)
    return [table]


def draw(document: Mapping[str, Any], folder: Path) -> list[Path]:
    """The residuals by Lode angle, a line a fit."""
    rows = document["results"]["rows"]
    models, materials = (list(dict.fromkeys(row[key] for row in rows)) for key in ("model", "material"))
    figure, axis = chart(height=3.0)
    styles = ("-", "--", ":", "-.", (0, (1, 3)), (0, (6, 3)))
    at = [-1.0 + (2 * k + 1) / BINS for k in range(BINS)]
    for row in rows:
        colour, style = COLOURS[models.index(row["model"])], styles[materials.index(row["material"]) % len(styles)]
        axis.plot(at, row["by_lode"], color=colour, linestyle=style, label=f"{row['material']}, {row['model']}")
    axis.set_yscale("log")
    axis.legend(fontsize=6, frameon=False, ncols=2)
    decorate(axis, "sine of three times the Lode angle of the trial strain", "residual of the return map [-]")
    return [save(figure, folder / f"{document['problem']}.png")]
