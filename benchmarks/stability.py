"""Which time steps keep a simulation stable: the survival map, and the limit above which a time step is refused."""

from collections.abc import Mapping
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

from benchmarks.checks import names, numbers, whole
from benchmarks.context import BenchmarkContext, Checkpointed
from benchmarks.stability_limits import limits_of, single_particle_limit
from benchmarks.stability_report import draw, tables
from benchmarks.survival import MOTIONS, PRECISIONS, TOLERANCE, Batch, fates
from pcnclaws.compiled.backend import BACKENDS, using_backend
from pcnclaws.evaluation.report import write_metrics
from pcnclaws.provenance import commit

__all__ = ["draw", "run", "tables"]

NAME = "stability"
CRITERION = (
    "stable: every particle stays finite, in the domain and the right way out, and kinetic plus elastic energy stays "
    f"below {1.0 + TOLERANCE:g} times that of the start with the fall to the floor"
)


def run(options: Mapping[str, Any], context: BenchmarkContext) -> dict[str, Any]:
    """The survival map and the limits.

    {"criterion", "cfl", "youngs_modulus", "poissons_ratio", "rows": [{"material", "flow", "motion", "precision",
    "per_cell", "cfl", "fates": a word for each youngs_modulus, a letter for each poissons_ratio}],
    "single_particle": predicted limits, "limits"}
    """
    batches, moduli = _batches(options), _moduli(options)
    steps, (backend,) = whole(options, "steps"), names({"backend": [options["backend"]]}, "backend", BACKENDS)
    key = {name: value for name, value in options.items() if name != "limits"}
    stored = Checkpointed.load(context.folder, NAME, {"options": key, "device": str(context.device)})
    rows = []
    with using_backend(backend):
        for number, batch in enumerate(batches):
            context.advance(number, len(batches), batch.name)
            letters = stored.row(batch.name, partial(fates, batch, moduli, steps, context.device))
            rows.append(batch._asdict() | {"fates": _words(letters, len(options["poissons_ratio"]))})
    context.advance(len(batches), len(batches), "done")
    axes = {name: [float(value) for value in options[name]] for name in ("cfl", "youngs_modulus", "poissons_ratio")}
    limits = limits_of(rows, axes["youngs_modulus"], axes["poissons_ratio"])
    if options["limits"] is not None:
        # for the refusal of time steps, pcnclaws/simulation/time_step.py
        write_metrics(Path(str(options["limits"])), {"options": key, "commit": commit(), "limits": limits})
    alone = [single_particle_limit(ratio) for ratio in axes["poissons_ratio"]]
    return axes | {"criterion": CRITERION, "rows": rows, "single_particle": alone, "limits": limits}


def _batches(options: Mapping[str, Any]) -> list[Batch]:
    """All batches, the large CFL numbers, which end early, last; UserError for a wrong option."""
    flows = {
        "elasticity": [None],
        "plasticine": numbers(options, "yield_strain", 0.0),
        "sand": numbers(options, "friction_angle", 0.0, 90.0),
        "neo_hookean": [None],
        "tresca": numbers(options, "yield_strain", 0.0),
    }
    materials = names(options, "materials", flows)
    motions, precisions = names(options, "motions", MOTIONS), names(options, "precisions", PRECISIONS)
    per_cell, levels = numbers(options, "per_cell", 0.4, 4.5), sorted(numbers(options, "cfl", 0.0))
    return [
        Batch(material, flow, *others)
        for material in materials
        for flow in flows[material]
        for others in product(motions, precisions, per_cell, levels)
    ]


def _moduli(options: Mapping[str, Any]) -> list[tuple[float, float]]:
    return list(product(numbers(options, "youngs_modulus", 0.0), numbers(options, "poissons_ratio", -1.0, 0.5)))


def _words(letters: str, length: int) -> list[str]:
    return [letters[first : first + length] for first in range(0, len(letters), length)]
