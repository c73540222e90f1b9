"""A case of verification: one sentence that must be true, our number beside theirs, and a tolerance."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np

WITHIN, OUTSIDE, NOT_HAD = "within", "outside", "not had"
Group = Literal["laws", "neural laws", "motion", "not had"]
Numbers: TypeAlias = Sequence[float] | np.ndarray
# Points of a curve that a result file keeps.
MOST_POINTS = 240


@dataclass(frozen=True)
class Line:
    """One line of a picture: what we have, and what they have at the same places, nothing for what they do not tell."""

    label: str
    x: Numbers
    ours: Numbers
    theirs: Numbers


@dataclass(frozen=True)
class Curve:
    """Lines to compare in a picture, and what its axes are called."""

    horizontal: str
    vertical: str
    lines: Sequence[Line]


@dataclass(frozen=True)
class Table:
    """A table beside the row of a case, its cells as text."""

    header: Sequence[str]
    lines: Sequence[Sequence[str]]


@dataclass(frozen=True)
class Outcome:
    """What was measured.

    ours, theirs  the numbers that are compared; of many, those that differ most
    difference    relative difference [-], that the tolerance bounds
    unit          of the numbers
    curve, table  what the page shows beside the row
    """

    ours: float
    theirs: float
    difference: float
    unit: str = ""
    curve: Curve | None = None
    table: Table | None = None


@dataclass(frozen=True)
class Case:
    """A case, declared in one place.

    name       word that the command knows it by
    group      part of the page
    sentence   what must be true
    source     of their number
    tolerance  largest relative difference [-], a round number: what the method promises, not what came out
    measure    our number and theirs; None for a case that cannot be had
    slow       takes more than a second or two
    why        why it is outside of its tolerance, or why it cannot be had; a row with a reason must be outside
    """

    name: str
    group: Group
    sentence: str
    source: str
    tolerance: float
    measure: Callable[[], Outcome] | None
    slow: bool = False
    why: str = ""

    @property
    def command(self) -> str:
        """What measures it alone."""
        return f"python -m benchmarks problem=verification problem.cases=[{self.name}]"

    @property
    def expected(self) -> str:
        """The verdict that the row is declared with."""
        if self.measure is None:
            return NOT_HAD
        return OUTSIDE if self.why else WITHIN

    def row(self, measured: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """A row of results, plain values, of what was measured before or else now."""
        found = dict(self.measured() if measured is None else measured)
        verdict = NOT_HAD
        if self.measure is not None:
            verdict = WITHIN if found["difference"] <= self.tolerance else OUTSIDE
        return found | {name: getattr(self, name) for name in _TOLD} | {"verdict": verdict}

    def measured(self) -> dict[str, Any]:
        """Measures the case: numbers, curve and table, plain values; nothing for a case that cannot be had."""
        if self.measure is None:
            return {}
        outcome = self.measure()
        return {
            "ours": float(outcome.ours),
            "theirs": float(outcome.theirs),
            "unit": outcome.unit,
            "difference": float(outcome.difference),
            "curve": None if outcome.curve is None else _plain_curve(outcome.curve),
            "table": None if outcome.table is None else {"header": [*outcome.table.header], "lines": _cells(outcome)},
        }


_TOLD = ("name", "group", "sentence", "source", "tolerance", "why", "command")


def absent(name: str, sentence: str, why: str) -> Case:
    """A case that cannot be had, with the reason."""
    return Case(name, "not had", sentence, "", 0.0, None, why=why)


def one_number(ours: float, theirs: float, unit: str = "", **shown: Any) -> Outcome:
    """A comparison of two numbers, relative to theirs."""
    return Outcome(ours, theirs, abs(ours - theirs) / abs(theirs), unit, **shown)


def violation(ours: float, **shown: Any) -> Outcome:
    """A relative error that should be 0: the number is its own difference."""
    return Outcome(ours, 0.0, abs(ours), **shown)


def many_numbers(ours: Numbers, theirs: Numbers, unit: str = "", **shown: Any) -> Outcome:
    """A comparison of many numbers, relative to the largest of theirs; the row shows the pair that differs most."""
    mine, other = np.ravel(np.asarray(ours, dtype=np.float64)), np.ravel(np.asarray(theirs, dtype=np.float64))
    apart = np.abs(mine - other)
    worst = int(apart.argmax())
    return Outcome(mine[worst], other[worst], apart[worst] / np.abs(other).max(), unit, **shown)


def lines_of(curve: Curve, unit: str = "") -> Outcome:
    """A comparison of the lines of a picture; of several, the one that differs most relative to its largest value."""
    outcomes = [many_numbers(line.ours, line.theirs, unit, curve=curve) for line in curve.lines]
    return max(outcomes, key=lambda outcome: outcome.difference)


def _plain_curve(curve: Curve) -> Mapping[str, Any]:
    lines = [
        {"label": line.label, **{name: _thinned(getattr(line, name)) for name in ("x", "ours", "theirs")}}
        for line in curve.lines
    ]
    return {"horizontal": curve.horizontal, "vertical": curve.vertical, "lines": lines}


def _thinned(values: Numbers) -> list[float]:
    array = np.asarray(values, dtype=np.float64)
    every = max(1, -(-len(array) // MOST_POINTS))
    return [float(f"{value:.7g}") for value in array[::every]]


def _cells(outcome: Outcome) -> list[list[str]]:
    return [[*line] for line in outcome.table.lines] if outcome.table else []
