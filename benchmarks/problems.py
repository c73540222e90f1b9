"""The benchmark problems: a fixed table from names to what runs, draws and tabulates them."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from rich.table import Table

from benchmarks import (
    between_kinds,
    coverage,
    data_parallel,
    fine_tuning,
    foreign_laws,
    fuzzing,
    imperfect_data,
    kills,
    own_laws,
    rendering,
    return_maps,
    run_time_vs_error,
    scaling,
    skips,
    stability,
    step_cost,
    training_methods,
    transfers,
    which_material,
)
from benchmarks import training_time as training
from benchmarks.context import BenchmarkContext
from benchmarks.real_beam import problem as real_beam
from benchmarks.stress import problem as stress
from benchmarks.verification import problem as verification

Document = Mapping[str, Any]


class Problem(NamedTuple):
    """One benchmark problem.

    run     (options, context) -> the results, plain values; checks its options first
    draw    (document, folder) -> the pictures it wrote, from the result document alone
    tables  document -> the tables that a reader wants to see, from the result document alone
    """

    run: Callable[[Mapping[str, Any], BenchmarkContext], dict[str, Any]]
    draw: Callable[[Document, Path], list[Path]]
    tables: Callable[[Document], list[Table]]


PROBLEMS = {
    "between_kinds": Problem(between_kinds.run, between_kinds.draw, between_kinds.tables),
    "coverage": Problem(coverage.run, coverage.draw, coverage.tables),
    "data_parallel": Problem(data_parallel.run, data_parallel.draw, data_parallel.tables),
    "fine_tuning": Problem(fine_tuning.run, fine_tuning.draw, fine_tuning.tables),
    "foreign_laws": Problem(foreign_laws.run, foreign_laws.draw, foreign_laws.tables),
    "fuzzing": Problem(fuzzing.run, fuzzing.draw, fuzzing.tables),
    "imperfect_data": Problem(imperfect_data.run, imperfect_data.draw, imperfect_data.tables),
    "kills": Problem(kills.run, kills.draw, kills.tables),
    "own_laws": Problem(own_laws.run, own_laws.draw, own_laws.tables),
    "real_beam": Problem(real_beam.run, real_beam.draw, real_beam.tables),
    "rendering": Problem(rendering.run, rendering.draw, rendering.tables),
    "return_maps": Problem(return_maps.run, return_maps.draw, return_maps.tables),
    "run_time_vs_error": Problem(run_time_vs_error.run, run_time_vs_error.draw, run_time_vs_error.tables),
    "scaling": Problem(scaling.run, scaling.draw, scaling.tables),
    "skips": Problem(skips.run, skips.draw, skips.tables),
    "stability": Problem(stability.run, stability.draw, stability.tables),
    "step_cost": Problem(step_cost.run, step_cost.draw, step_cost.tables),
    "stress": Problem(stress.run, stress.draw, stress.tables),
    "training": Problem(training.run, training.draw, training.tables),
    "training_methods": Problem(training_methods.run, training_methods.draw, training_methods.tables),
    "transfers": Problem(transfers.run, transfers.draw, transfers.tables),
    "verification": Problem(verification.run, verification.draw, verification.tables),
    "which_material": Problem(which_material.run, which_material.draw, which_material.tables),
}
