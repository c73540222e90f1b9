"""The page of estimates: python -m pcnclaws.results_page.estimation docs/results/estimation docs/estimation_results.md.

It is made of <folder>/<object>/<way>.json, outputs of `python -m pcnclaws.estimate`.
"""

import sys
from collections.abc import Mapping
from pathlib import Path

from pcnclaws.data.atomic import replaced_file
from pcnclaws.errors import UserError
from pcnclaws.results_page.cells import table
from pcnclaws.results_page.documents import Document, read_document

WAYS = {
    "analytic": "analytic law",
    "analytic_unscreened": "analytic law, no screening",
    "pretrained": "neural law",
    "pretrained_unscreened": "neural law, no screening",
    "adam": "neural law, Adam",
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
SYMBOLS = {
    "youngs_modulus": "E [kPa]",
    "poissons_ratio": "\N{GREEK SMALL LETTER NU}",
    "friction_angle": "φ [°]",
    "yield_stress": "τ_Y [kPa]",
}
THOUSANDS = ("youngs_modulus", "yield_stress")

INTRODUCTION = """\
The nine objects of the paper, observed for 500 steps in every fifth frame, from the paper's own guesses. Each cell is
the estimate with its 95 % interval; the truth is simulated with the analytic law. Written by `make tables` from the
JSON files in [results/estimation](results/estimation), which hold command, hardware, versions and commit. The neural
laws are those that ship; the nine objects are in none of their training data. The seconds are those of the whole
command on one thread, and depend on what else the machine did."""


def estimation_page(folder: Path) -> str:
    """The page in Markdown; UserError for a folder without results."""
    found = {path: read_document(path, "parameters", "estimate") for path in sorted(folder.glob("*/*.json"))}
    if not found:
        raise UserError(f"{folder}: holds no results; accepted: a folder of <object>/<way>.json")
    objects = sorted({path.parent.name for path in found})
    parts = [
        "# Estimates",
        INTRODUCTION,
        *(_object(name, {p.stem: values for p, values in found.items() if p.parent.name == name}) for name in objects),
        _summary(found),
    ]
    return "\n\n".join(parts) + "\n"


def _object(name: str, ways: Mapping[str, Document]) -> str:
    first = next(iter(ways.values()))["parameters"]
    names = list(first)
    lines = [["truth", *(_number(n, first[n]["truth"]) for n in names), "", "", ""]]
    lines.append(["guess", *(_number(n, first[n]["guess"]) for n in names), "", "", ""])
    if name in PAPER:
        published = zip(names, PAPER[name], strict=True)
        lines.append(["the paper's", *(_number(n, value) for n, value in published), "", "", ""])
    for way in (way for way in WAYS if way in ways):
        one = ways[way]
        cells = (_cell(n, one["parameters"][n]) for n in names)
        lines.append([WAYS[way], *cells, f"{one['mse']:.1e}", str(one["iterations"]), f"{one['seconds']:.0f}"])
    header = ["", *(SYMBOLS[n] for n in names), "MSE [m²]", "iterations", "seconds"]
    return f"## {name.replace('_', ' ').capitalize()}\n\n{table(header, lines)}"


def _summary(found: Mapping[Path, Document]) -> str:
    """How many intervals hold the truth, and the largest differences, by way."""
    lines = []
    for way, word in WAYS.items():
        numbers = [one for path, values in found.items() if path.stem == way for one in values["parameters"].values()]
        known = [one for one in numbers if one["identifiable"]]
        if not known:
            continue
        held = sum(one["interval_95"][0] <= one["truth"] <= one["interval_95"][1] for one in known)
        worst = []
        for name, symbol in SYMBOLS.items():
            of_way = [values["parameters"].get(name) for path, values in found.items() if path.stem == way]
            errors = [_off(name, one) for one in of_way if one is not None and one["identifiable"]]
            worst.append(f"{symbol.partition(' ')[0]} {_worst(name, max(errors))}" if errors else "")
        lines.append([word, f"{held} of {len(known)}", "; ".join(filter(None, worst))])
    return "## All\n\n" + table(["", "intervals that hold the truth", "largest differences"], lines)


def _off(name: str, one: Document) -> float:
    difference = abs(one["estimate"] - one["truth"])
    return difference / one["truth"] if name in THOUSANDS else difference


def _worst(name: str, error: float) -> str:
    return f"{100.0 * error:.2g} %" if name in THOUSANDS else f"{error:.2g}" + ("°" if name == "friction_angle" else "")


def _cell(name: str, one: Document) -> str:
    if not one["identifiable"]:
        return "not told"
    low, high = (_number(name, end) for end in one["interval_95"])
    return f"{_number(name, one['estimate'])} ({low} to {high})"


def _number(name: str, value: float) -> str:
    return f"{value / 1e3:.5g}" if name in THOUSANDS else f"{value:.4g}"


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
        unfinished.write_text(text, encoding="utf-8")
    print(f"wrote {output}")


if __name__ == "__main__":
    main()
