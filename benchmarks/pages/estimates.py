"""The page of estimates: python -m benchmarks.pages.estimates docs/results/estimation docs/estimation_results.md.

It is made of <folder>/<object>/<way>.json, outputs of `python -m pcnclaws.estimate`.
"""

import sys
from collections.abc import Mapping
from pathlib import Path

from benchmarks.pages.cells import table
from benchmarks.pages.documents import Document, read_document
from benchmarks.pages.mismatch import mismatch_section
from benchmarks.pages.searches import compared_searches, searches_picture
from pcnclaws.atomic import replaced_file
from pcnclaws.errors import UserError
from pcnclaws.laws.parameters import PARAMETERS

WAYS = {
    "analytic": "analytic law",
    "analytic_unscreened": "analytic law, no screening",
    "pretrained": "neural law",
    "pretrained_unscreened": "neural law, no screening",
    "adam": "neural law, Adam",
    "softer": "neural law, E guessed at a tenth",
    "stiffer": "neural law, E guessed tenfold",
    "stiffer_unscreened": "neural law, E guessed tenfold, no screening",
    "markers": "analytic law, 100 markers",
    "points": "analytic law, 500 points without labels",
    "mismatched": "analytic law, 100 markers of a finer simulation",
    "mismatched_third": "analytic law, 100 markers of one three times as fine",
    "refined": "analytic law, finer grids, 100 markers of a finer simulation",
    "refined_third": "analytic law, finer grids, 100 markers of one three times as fine",
}
# Of benchmarks/parts.py.
TRUTHS = {
    "several_bodies": {
        "youngs_modulus[body_0]": 1.0e5,
        "youngs_modulus[body_1]": 2.5e5,
        "youngs_modulus[body_2]": 1.6e5,
        "poissons_ratio[body_0]": 0.30,
        "poissons_ratio[body_1]": 0.15,
        "poissons_ratio[body_2]": 0.22,
    },
    "graded_body": {
        "youngs_modulus[low_x]": 0.8e5,
        "youngs_modulus[high_x]": 3.0e5,
        "poissons_ratio[low_x]": 0.2,
        "poissons_ratio[high_x]": 0.2,
    },
}
# By truth: what the paper's estimate was.
PAPER = {
    "elasticity_1": (1.84e5, 0.20),
    "elasticity_2": (1.50e5, 0.22),
    "elasticity_3": (2.06e5, 0.19),
    "plasticine_1": (1.13e5, 0.41, 3.1e3),
    "plasticine_2": (2.92e5, 0.45, 4.6e3),
    "plasticine_3": (4.48e5, 0.39, 5.3e3),
    "sand_1": (3.74e5, 0.19, 29.7),
    "sand_2": (3.36e5, 0.21, 25.1),
    "sand_3": (2.71e5, 0.27, 22.0),
}
INTRODUCTION = """\
The nine objects of the paper, observed for 500 steps in every fifth frame, from the paper's own guesses. Each cell is
the estimate with its 95 % interval; the truth is simulated with the analytic law. Written by `make tables` from the
JSON files in [results/estimation](results/estimation), which hold command, hardware, versions and commit. The neural
laws are those that ship; the nine objects are in none of their training data. The seconds are those of the whole
command on one thread, and depend on what else the machine did: those of the neural law with and without screening
were measured alone but for sand 2 and 3, most others beside one to three other processes on two cores.

*Markers* are 100 particles of the surface, seen in every 50th step, each coordinate with a noise of 1 mm, a tenth of
them missing; start velocity and spin are estimated along. *Of a finer
simulation*: the motion was simulated with half the time step, half the grid spacing and eight times the particles, or a
third and 27 times, and is explained with the usual ones, a body of `scene.lattice=centres`, `unknown.walls=true` and
`discrepancy=true`. The margin of these intervals was chosen so that those of elasticity 1 and plasticine 1 of half the
spacing hold the truth; the others are a test of it. Those with *finer grids* are as [below](#motions-of-other-grids).

*Points without labels* are some 500 in every fifth step, other ones each time, on the part of the surface that a camera
above a corner of the cube sees, each coordinate with a noise of 2 mm; start velocity, spin and the offset of the
surface are estimated along."""

PICTURE = "estimation_searches.png"
SEARCHES = f"""\
## Gauss-Newton and Adam

The error over the iterations, with the neural laws and without screening. Adam has 150 iterations; where they were too
few, the result says so, and its intervals reach to the minimum that it was on its way to.

![Searches](images/{PICTURE})"""


def estimates(folder: Path) -> dict[str, dict[str, Document]]:
    """The results by object and way; UserError for a folder without any."""
    found = {path: read_document(path, "parameters", "estimate") for path in sorted(folder.glob("*/*.json"))}
    if not found:
        raise UserError(f"{folder}: holds no results; accepted: a folder of <object>/<way>.json")
    by_object: dict[str, dict[str, Document]] = {}
    for path, values in found.items():
        by_object.setdefault(path.parent.name, {})[path.stem] = values
    return by_object


def estimation_page(folder: Path) -> str:
    """The page in Markdown; UserError for a folder without results."""
    by_object = estimates(folder)
    truths = {name: _truth(name, ways) for name, ways in by_object.items()}
    paper = [name for name in by_object if name not in TRUTHS]
    parts = [
        "# Estimates",
        INTRODUCTION,
        _summary({name: by_object[name] for name in paper}, truths),
        *filter(None, [mismatch_section(by_object, truths)]),
        *_coverage(folder),
        *([SEARCHES] if compared_searches(by_object) else []),
        *(_object(name, by_object[name], truths[name]) for name in [*paper, *(n for n in TRUTHS if n in by_object)]),
    ]
    return "\n\n".join(parts) + "\n"


def _truth(name: str, ways: Mapping[str, Document]) -> Mapping[str, float]:
    """The true numbers of an object by label: the example's, or what the results hold that know the truth."""
    if name in TRUTHS:
        return TRUTHS[name]
    known = {label: one["truth"] for way in ways.values() for label, one in way["parameters"].items() if "truth" in one}
    if not known:
        raise UserError(
            f"{name}: none of its results holds the truth; accepted: at least one made from a trajectory file"
        )
    return known


def _object(name: str, ways: Mapping[str, Document], truth: Mapping[str, float]) -> str:
    first = next(iter(ways.values()))["parameters"]
    labels = list(first)
    lines = [["truth", *(_number(label, truth[label]) for label in labels), "", "", ""]]
    lines.append(["guess", *(_number(label, first[label]["guess"]) for label in labels), "", "", ""])
    if name in PAPER:
        published = zip(labels, PAPER[name], strict=True)
        lines.append(["the paper's", *(_number(label, value) for label, value in published), "", "", ""])
    for way in (way for way in WAYS if way in ways):
        one = ways[way]
        cells = (_cell(label, one["parameters"][label]) for label in labels)
        lines.append([WAYS[way], *cells, f"{one['mse']:.1e}", str(one["iterations"]), f"{one['seconds']:.0f}"])
    header = ["", *(_symbol(label) for label in labels), "MSE [m²]", "iterations", "seconds"]
    pictures = f"\n\n![{name}](images/{name}_fit.png)" if name in TRUTHS else ""
    return f"## {name.replace('_', ' ').capitalize()}\n\n{table(header, lines)}{pictures}"


def _summary(by_object: Mapping[str, Mapping[str, Document]], truths: Mapping[str, Mapping[str, float]]) -> str:
    """By way: how many intervals hold the truth, the largest differences, and the widest intervals."""
    lines = []
    for way, word in WAYS.items():
        numbers = [
            (label, one, truths[name][label])
            for name, ways in by_object.items()
            if way in ways
            for label, one in ways[way]["parameters"].items()
        ]
        known = [(label, one, true) for label, one, true in numbers if one["identifiable"]]
        if not known:
            continue
        held = sum(one["interval_95"][0] <= true <= one["interval_95"][1] for _, one, true in known)
        worst, widest, seconds = [], [], [ways[way]["seconds"] for ways in by_object.values() if way in ways]
        for name, parameter in PARAMETERS.items():
            of_name = [(one, true) for label, one, true in known if label == name]
            if of_name:
                short = parameter.label.partition(" ")[0]
                worst.append(
                    f"{short} {_off(name, max(_relative(name, one['estimate'] - t, t) for one, t in of_name))}"
                )
                width = max(_relative(name, one["interval_95"][1] - one["interval_95"][0], t) for one, t in of_name)
                widest.append(f"{short} {_off(name, width)}")
        told = f"{held} of {len(known)}" + (
            f", {len(numbers) - len(known)} not told" if len(known) < len(numbers) else ""
        )
        lines.append([word, told, "; ".join(worst), "; ".join(widest), f"{max(seconds):.0f}"])
    header = ["", "intervals that hold the truth", "largest differences", "widest intervals", "longest [s]"]
    return "## All\n\n" + table(header, lines)


def _coverage(folder: Path) -> list[str]:
    """How many numbers of new objects lie in the intervals of the calibration that ships."""
    lines = []
    for path in sorted(folder.glob("coverage_*.json")):
        values = read_document(path, "covered_before", "calibrate")
        of_objects = values["projected"]
        numbers = sum(len(errors) for errors in of_objects)
        held = round(values["covered_before"] * numbers)
        lines.append([values["material"], str(len(of_objects)), f"{held} of {numbers}"])
    if not lines:
        return []
    words = "Random objects that are in no data set and not among those of the calibration, with the neural laws:"
    return [f"## Objects at random\n\n{words}\n\n{table(['', 'objects', 'intervals that hold the truth'], lines)}"]


def _relative(name: str, difference: float, truth: float) -> float:
    return abs(difference) / truth if PARAMETERS[name].logarithmic else abs(difference)


def _off(name: str, error: float) -> str:
    parameter = PARAMETERS[name]
    return f"{100.0 * error:.2g} %" if parameter.logarithmic else f"{error:.2g}{parameter.shown_unit}"


def _cell(label: str, one: Document) -> str:
    if one["estimate"] is None:
        return "not told"
    if one["interval_95"] is None:
        return f"{_number(label, one['estimate'])} (not fitted)"
    low, high = (_number(label, end) for end in one["interval_95"])
    return f"{_number(label, one['estimate'])} ({low} to {high})"


def _symbol(label: str) -> str:
    name, _, part = label.partition("[")
    return f"{PARAMETERS[name].label} {part.rstrip(']').replace('_', ' ')}".strip()


def _number(label: str, value: float) -> str:
    factor = PARAMETERS[label.partition("[")[0]].display_factor
    return f"{value:.4g}" if factor == 1.0 else f"{value * factor:.5g}"


def main() -> None:
    """The command."""
    if len(sys.argv) != 3:
        sys.exit("accepted: the folder of estimates and the page, docs/results/estimation docs/estimation_results.md")
    folder, output = map(Path, sys.argv[1:])
    try:
        text = estimation_page(folder)
    except UserError as fault:
        print(fault, file=sys.stderr)
        sys.exit(2)
    with replaced_file(output) as unfinished:
        unfinished.write(text.encode())
    print(f"wrote {output}")
    if searches := compared_searches(estimates(folder)):
        print(f"wrote {searches_picture(searches, output.parent / 'images' / PICTURE)}")


if __name__ == "__main__":
    main()
