"""From rows of run time and error to orders of convergence, and to how good the references themselves are."""

from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks.orders import GridError, error_of_reference, orders_of

Row = Mapping[str, Any]
SERIES = ("problem", "material", "law")
# What stays the same when the grid becomes finer, the time step with it.
HELD = ("per_cell", "time_factor", "precision", "skips", "backend")


def orders_table(rows: Sequence[Row], references: Sequence[Row]) -> list[dict[str, Any]]:
    """Orders of every series of at least two grids: [{series, what is held, "grid_nodes", "errors", "orders"}].

    A floor scene is compared with a run of one ratio of time step to grid spacing: series of other ratios tend to
    another limit, and have no order there.
    """
    of_series = {_values(reference, SERIES): reference for reference in references}
    table = []
    for held in dict.fromkeys(_values(row, (*SERIES, *HELD)) for row in rows):
        some = sorted((row for row in rows if _values(row, (*SERIES, *HELD)) == held), key=_nodes)
        reference = of_series.get(held[: len(SERIES)])
        if any(row["error"] is None for row in some) or len(some) < 2:
            continue
        if reference and reference["time_factor"] != some[0]["time_factor"]:
            continue
        errors = [GridError(1.0 / row["grid_nodes"], row["error"]) for row in some]
        table.append(
            dict(zip((*SERIES, *HELD), held, strict=True))
            | {"grid_nodes": [row["grid_nodes"] for row in some], "errors": [error.error for error in errors]}
            | {"orders": orders_of(errors, 1.0 / reference["grid_nodes"] if reference else 0.0)}
        )
    return table


def reference_errors(references: Sequence[Row], orders: Sequence[Row]) -> list[dict[str, Any]]:
    """The references, each with an estimate of its own error from the errors and the order of coarser runs like it."""
    return [dict(reference) | {"estimated_error": _own_error(reference, orders)} for reference in references]


def _own_error(reference: Row, orders: Sequence[Row]) -> float | None:
    """C h^p of the reference; None where its series has no order."""
    for series in orders:
        if _values(series, (*SERIES, *HELD)) != _values(reference, (*SERIES, *HELD)) or not series["orders"][-1]:
            continue
        finest = GridError(1.0 / series["grid_nodes"][-1], series["errors"][-1])
        return error_of_reference(finest, series["orders"][-1], 1.0 / reference["grid_nodes"])
    return None


def _values(row: Row, names: Sequence[str]) -> tuple[Any, ...]:
    return tuple(row[name] for name in names)


def _nodes(row: Row) -> int:
    return row["grid_nodes"]
