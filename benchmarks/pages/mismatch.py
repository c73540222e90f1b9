"""Of the page of estimates: what comes of markers of motions that were simulated on other grids than the estimate's."""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from benchmarks.pages.cells import table
from benchmarks.pages.documents import Document
from pcnclaws.laws.parameters import PARAMETERS

# Ways by their words, and the spacing of the grid of the motion [m].
WAYS = {
    "refined": ("half the spacing, finer grids", 0.05 / 2),
    "refined_third": ("a third, finer grids", 0.05 / 3),
    "mismatched": ("half the spacing, one grid", 0.05 / 2),
    "mismatched_third": ("a third, one grid", 0.05 / 3),
}
# The same markers of a motion of the grid of the estimate.
WITHOUT = "markers"
# What is asked for: errors of a parameter [share of the truth, or its own unit], and the width of an interval over that
# without mismatch.
MOST_OFF = {"youngs_modulus": 0.05, "yield_stress": 0.05, "poissons_ratio": 0.03, "friction_angle": 1.0}
MOST_WIDE = 4.0
WORDS = """\
## Motions of other grids

Each cell has the difference from the truth, and how many times as wide the interval is as that of markers of a motion
of the estimate's own grid. It is **bold** where the interval does not hold the truth, and the difference is in
parentheses where it is above what is asked for: 5 % of moduli and yield stress, 0.03 of Poisson's ratio, 1 degree of
friction. *One grid* is the paper's, with `unknown.walls=true discrepancy=true`; *finer grids* have `unknown.size=true`
and `refinements=[1.5,2.5]` besides, grids of 3.33 cm and 2 cm, none of which is that of a motion (2.5 cm and 1.67 cm).
Both kinds of grid are of the same method: how such estimates fare with motions of other programs is not known. The
bodies of the motions have `scene.lattice=faces`; they weigh and swing as if they were 5.3 % and 3.4 % larger than their
outermost particles are apart, which *size* has to find. Seconds of the finer
grids are those of a machine with three to eight other processes on two cores."""


class Number(NamedTuple):
    """An estimate of a parameter beside its truth.

    off    difference [share of the truth, or its own unit], None where it was not told
    held   whether the interval holds the truth
    wide   width of the interval over that without mismatch
    """

    name: str
    off: float | None
    held: bool
    wide: float

    @property
    def good(self) -> bool:
        """Whether the difference is at most what is asked for."""
        return self.off is not None and abs(self.off) <= MOST_OFF[self.name]


def mismatch_section(by_object: Mapping[str, Mapping[str, Document]], truths: Mapping[str, Mapping[str, float]]) -> str:
    """The section in Markdown; empty without such estimates."""
    summary, lines = [], []
    for way, (words, spacing) in WAYS.items():
        found = {name: ways[way] for name, ways in by_object.items() if way in ways and WITHOUT in ways}
        numbers = {name: list(_numbers(one, by_object[name][WITHOUT], truths[name])) for name, one in found.items()}
        if not found:
            continue
        summary.append([words, str(len(found)), *_counts([one for some in numbers.values() for one in some])])
        for name, one in found.items():
            cells = [_cell(number) for number in numbers[name]]
            cells += [""] * (3 - len(cells))
            lines.append([name.replace("_", " "), words, *cells, *_grid(one, spacing), f"{one['seconds']:.0f}"])
    if not lines:
        return ""
    counted = [
        "",
        "objects",
        "differences as asked for",
        "intervals that hold",
        "not told",
        "intervals up to 4 times as wide",
    ]
    symbols = [PARAMETERS[name].label.partition(" ")[0] for name in MOST_OFF]
    columns = [*symbols[:1], symbols[2], f"{symbols[1]}, {symbols[3]}"]
    header = ["", "motion of", *columns, "spacing found [cm]", "size found", "seconds"]
    return f"{WORDS}\n\n{table(counted, summary)}\n\n{table(header, lines)}"


def _numbers(one: Document, without: Document, truth: Mapping[str, float]) -> Iterator[Number]:
    for name, found in one["parameters"].items():
        if found["estimate"] is None or found["interval_95"] is None:
            yield Number(name, None, False, np.inf)
            continue
        (low, high), true = found["interval_95"], truth[name]
        scale = true if PARAMETERS[name].logarithmic else 1.0
        least, most = without["parameters"][name]["interval_95"]
        yield Number(name, (found["estimate"] - true) / scale, low <= true <= high, (high - low) / (most - least))


def _counts(numbers: list[Number]) -> list[str]:
    told = [number for number in numbers if number.off is not None]
    good, held, narrow = (
        sum(some) for some in zip(*((n.good, n.held, n.wide <= MOST_WIDE) for n in told), strict=True)
    )
    of_all, of_told = f"of {len(numbers)}", f"of {len(told)}"
    return [f"{good} {of_all}", f"{held} {of_told}", str(len(numbers) - len(told)), f"{narrow} {of_told}"]


def _cell(number: Number) -> str:
    if number.off is None:
        return "not told"
    parameter = PARAMETERS[number.name]
    off = f"{100.0 * number.off:+.1f} %" if parameter.logarithmic else f"{number.off:+.2g}{parameter.shown_unit}"
    words = f"{off if number.good else f'({off})'}, {number.wide:.1f} times"
    return words if number.held else f"**{words}**"


def _grid(one: Document, spacing: float) -> tuple[str, str]:
    found, size = (one["motion"].get(name) for name in ("grid_spacing", "size"))
    if found is None or found["estimate"] is None:
        return "", ""
    bigger = "" if size is None or size["estimate"] is None else f"{100.0 * size['estimate']:+.1f} %"
    return f"{100.0 * found['estimate']:.2f} of {100.0 * spacing:.2f}", bigger
