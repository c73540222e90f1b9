"""The three parts of the stress problem, resumable: scenes at the edge, long runs, derivatives."""

from collections.abc import Mapping
from functools import partial
from itertools import product
from typing import Any

from benchmarks.checks import names, whole, wholes
from benchmarks.context import BenchmarkContext, Checkpointed
from benchmarks.stress.cases import AXES, LAWS, MATERIALS, cases
from benchmarks.stress.fates import TOLERANCE, fate_of
from benchmarks.stress.gradients import AGREEMENT, UNKNOWNS, compare, landscape
from benchmarks.stress.long_runs import long_run
from benchmarks.stress.report import draw, tables
from pcnclaws.compiled.backend import BACKENDS

__all__ = ["draw", "run", "tables"]

NAME = "stress"


def run(options: Mapping[str, Any], context: BenchmarkContext) -> dict[str, Any]:
    """{"fates": [...], "long": [...], "gradients": [...], "landscapes": [...], "tolerance", "agreement"}.

    Each row is what the modules of this folder say of it, with "material", "law", ...
    """
    materials, laws = names(options, "materials", MATERIALS), names(options, "laws", LAWS)
    axes = names(options, "axes", AXES) if options["axes"] else list(AXES)
    long_steps = whole(options, "long_steps", least=0)
    horizons = wholes(options, "gradient_steps") if options["gradient_steps"] else []
    backends = names(options, "gradient_backends", BACKENDS)
    # a row is one of a case: whatever other cases are asked for, it holds
    stored = Checkpointed.load(context.folder, NAME, {"device": str(context.device), "long_steps": long_steps})
    stressed = [case for case in cases(materials, laws) if case.axis in axes]
    long = list(product(materials, laws)) if long_steps else []
    derivatives = list(product(horizons, backends, materials, UNKNOWNS))
    found: dict[str, list[dict[str, Any]]] = {"fates": [], "long": [], "gradients": []}
    plan = (
        *(
            ("fates", {"material": case.material, "law": case.law, "axis": case.axis, "value": case.value},
             partial(fate_of, case))
            for case in stressed
        ),
        *(("long", {"material": material, "law": law}, partial(long_run, material, law, long_steps))
          for material, law in long),
        *(
            ("gradients", {"material": material, "unknown": unknown, "steps": steps, "backend": backend},
             partial(compare, material, unknown, steps, backend))
            for steps, backend, material, unknown in derivatives
        ),
    )  # fmt: skip
    for number, (part, labels, make) in enumerate(plan):
        words = ", ".join(str(label) for label in labels.values())
        context.advance(number, len(plan), words)
        found[part].append(labels | stored.row(f"{part}: {words}", make))
    rough = [row for row in found["gradients"] if row["difference_error"] > AGREEMENT]
    context.advance(len(plan), len(plan), "pictures")
    return found | {
        "landscapes": [_landscape(row, stored) for row in rough],
        "tolerance": TOLERANCE,
        "agreement": AGREEMENT,
    }


def _landscape(row: Mapping[str, Any], stored: Checkpointed) -> dict[str, Any]:
    labels = {name: row[name] for name in ("material", "unknown", "steps")}
    key = f"landscape: {', '.join(map(str, labels.values()))}"
    return labels | {"slope": row["reverse"]} | stored.row(key, lambda: dict(landscape(*labels.values())))
