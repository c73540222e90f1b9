"""The page of stressed scenes: python -m benchmarks.pages.stress docs/results/stress.json docs/stress.md."""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.document import read_document
from benchmarks.pages.cells import table
from benchmarks.pages.command import write_and_say
from benchmarks.stress.fates import HOLDS, REFUSED, STOPPED
from benchmarks.stress.long_runs import MOST_CREEP, MOST_DRIFT, MOST_GROWTH, verdicts
from benchmarks.stress.report import WORDS, draw
from pcnclaws.atomic import replaced_file

Row = Mapping[str, Any]
INTRODUCTION = """# Scenes at the edge

One quantity of an ordinary scene at a time is brought to the edge of what it may be, and beyond: a cube of 512
particles that meets the floor at 2 m/s, with the analytic and with the shipped laws. A scene *holds* where everything
stays finite, and kinetic energy and that of gravity stay below {bound:g} times all that the scene can draw on (its
start, elastic energy of a deformed start, moving obstacles); otherwise it is to end with one line that names scene,
step, particle, reason, and what to change. Written by `make tables` from [stress.json](results/stress.json), which
holds command, hardware, versions, commit and seed; `python -m benchmarks problem=stress` measures it, and goes on where
it was interrupted. Parts of it are tests.

![Survival map](images/stress_survival.png)
"""
LONG = """## Twenty thousand steps

A dropped cube, and one afloat without gravity. *Growth*: the largest growth of kinetic, elastic and gravitational
energy from one frame to any later one after the last impact, over the energy of the start, at most {growth:g}.
*Drift*: how far the middle of the body moves in the last quarter, over dx, at most {drift:g}. *Creep*: the largest
change of F by the return map at 20 000 strains inside the yield surface, at most {creep:g}. Sand misses the drift: on
this floor, which has no friction, a heap goes on running out. Sand that lies, in a bin and to a slope, stays
([verification.md](verification.md), `sand_at_rest`).
"""
GRADIENTS = """## Derivatives

Of a number of the final positions, in double precision, through impact, sliding and yield: reverse mode beside
forward mode and the best of four central differences; the largest relative deviation of five unknowns (parameters,
values of each particle, start velocity, friction of an obstacle, weights). Kernels have no forward mode for weights.
"""


def page(document: Mapping[str, Any]) -> str:
    """The page in Markdown."""
    results = document["results"]
    parts = [INTRODUCTION.format(bound=1.0 + results["tolerance"]), _counts(results["fates"]), _ends(results["fates"])]
    if results["long"]:
        bounds = {"growth": MOST_GROWTH, "drift": MOST_DRIFT, "creep": MOST_CREEP}
        parts += [LONG.format(**bounds), _long(results["long"])]
    if results["gradients"]:
        parts += [GRADIENTS, _gradients(results["gradients"]), _smoothness(results)]
    return "\n".join(part for part in parts if part)


def _counts(rows: Sequence[Row]) -> str:
    met = [fate for fate in WORDS if any(row["fate"] == fate for row in rows)]
    lines = []
    for material, law in dict.fromkeys((row["material"], row["law"]) for row in rows):
        fates = [row["fate"] for row in rows if (row["material"], row["law"]) == (material, law)]
        lines.append([f"{material}, {law}", *(str(fates.count(fate)) for fate in met)])
    return table(["law", *(WORDS[fate] for fate in met)], lines)


def _ends(rows: Sequence[Row]) -> str:
    """Every scene that did not hold, with what was said."""
    ends = [row for row in rows if row["fate"] != HOLDS]
    unexplained = [row for row in ends if row["fate"] not in (REFUSED, STOPPED)]
    words = "none of them unexplained" if not unexplained else f"{len(unexplained)} of them unexplained"
    head = f"## Every scene that did not hold: {words}\n\n"
    lines = [
        [f"{row['material']}, {row['law']}", f"{row['axis']}: {row['value']}", row["fate"], row["reason"]]
        for row in ends
    ]
    return head + table(["law", "quantity", "end", "what was said"], lines)


def _long(rows: Sequence[Row]) -> str:
    names = ("growth", "drift", "floating_drift", "creep")
    lines = []
    for row in rows:
        missed = [name for name, holds in verdicts(row).items() if not holds]
        shown = ("-" if row[name] is None else f"{row[name]:.1e}" for name in names)
        told = f"misses {', '.join(missed)}" if missed else "holds"
        lines.append([f"{row['material']}, {row['law']}", f"{row['seconds']:.0f} s", *shown, told])
    return table(["law", "time", "growth", "drift", "drift afloat", "creep", ""], lines)


def _gradients(rows: Sequence[Row]) -> str:
    lines = []
    for steps, backend, material in dict.fromkeys((row["steps"], row["backend"], row["material"]) for row in rows):
        same = [row for row in rows if (row["steps"], row["backend"], row["material"]) == (steps, backend, material)]
        worst = [max(row.get(f"{mode}_error", 0.0) for row in same) for mode in ("forward", "difference")]
        lines.append([material, str(steps), backend, *(f"{one:.1e}" for one in worst)])
    return table(["material", "steps", "backend", "forward", "central difference"], lines)


def _smoothness(results: Mapping[str, Any]) -> str:
    rough = [row for row in results["gradients"] if row["difference_error"] > results["agreement"]]
    if not rough:
        return f"\nAll agree to {results['agreement']:g}: these motions are smooth in what they were changed by.\n"
    named = ", ".join(dict.fromkeys(f"{row['material']} by {row['unknown']} at {row['steps']} steps" for row in rough))
    return (
        f"\nBeyond {results['agreement']:g}: {named}. There the motion has kinks, where particles begin and cease "
        "to yield, to stick and to slide: both modes agree with each other and give the slope of the piece that the "
        "value lies on, a difference the mean slope over its step.\n\n![Landscapes](images/stress_landscapes.png)\n"
    )


def write_page(source: Path, output: Path) -> list[Path]:
    """Writes the page, and its pictures in a folder beside it."""
    document = read_document(source, "stress")
    (output.parent / "images").mkdir(exist_ok=True)
    with replaced_file(output) as part:
        part.write(page(document).encode())
    return [output, *draw(document, output.parent / "images")]


def main() -> None:
    """The command."""
    if len(sys.argv) != 3:
        sys.exit("accepted: a result file and its page, docs/results/stress.json docs/stress.md")
    source, output = map(Path, sys.argv[1:])
    write_and_say(lambda: write_page(source, output))


if __name__ == "__main__":
    main()
