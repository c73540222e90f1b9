"""Writes the page of results: python -m pcnclaws.results_page docs/results/accuracy docs/results.md.

<folder>/<material>/<row>/<task>.json   metrics of `python -m pcnclaws.evaluate`, a row being one law
"""

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pcnclaws.data.atomic import replaced_file
from pcnclaws.errors import UserError

TASKS = ("reconstruction", "long_term", "geometry", "unseen", "unseen_motion", "resolution", "outside_range")
# Rows in the order of the page, and what they are called.
ROWS = {
    "multi": "-M",
    "single": "-S",
    "multi_positions": "-M, positions only",
    "multi_paper": "-M, the paper's networks",
    "structure": "structure alone, untrained",
    "no_prior": "-M without the prior",
}
# The paper's errors [m^2] by material and row: training motion, twice its length, other shapes, unseen parameters (the
# mean of its two objects).
PAPER_TASKS: tuple[str, ...] = ("reconstruction", "long_term", "geometry", "unseen")
PAPER: dict[str, dict[str, tuple[float | None, ...]]] = {
    "elasticity": {"-S": (5.9e-5, 1.4e-4, 3.2e-4, None), "-M": (2.6e-4, 2.2e-3, 2.1e-3, 4.1e-4)},
    "plasticine": {"-S": (8.6e-5, 2.6e-4, 4.5e-4, None), "-M": (4.1e-4, 5.2e-3, 4.0e-3, 3.25e-4)},
    "sand": {"-S": (5.8e-5, 1.3e-4, 3.3e-4, None), "-M": (1.5e-4, 1.1e-3, 5.4e-4, 2.3e-4)},
}
HEADER = """# Accuracy

Mean squared position error [m²] (mean over particles, coordinates and every 5th step), means over the scenes of a task;
in brackets the relative error of the stress at the true states after contact. The tasks and measures:
[evaluation.md](evaluation.md). Written by `make tables` from the JSON files in [results/accuracy](results/accuracy),
which hold command, hardware, versions, commit and seed.
"""


def page(folder: Path) -> str:
    """The page in Markdown; UserError for a folder without results."""
    found = _read(folder)
    if not found:
        raise UserError(f"{folder}: holds no results; accepted: a folder of <material>/<row>/<task>.json")
    return "\n".join([HEADER, *(_section(material, rows) for material, rows in sorted(found.items()))])


def _read(folder: Path) -> dict[str, dict[str, dict[str, Any]]]:
    """Material -> row -> task -> document."""
    found: dict[str, dict[str, dict[str, Any]]] = {}
    for path in sorted(folder.glob("*/*/*.json")):
        material, row = path.parts[-3:-1]
        try:
            document = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError) as fault:
            raise UserError(f"{path}: not readable ({fault}); accepted: the output of evaluate") from fault
        found.setdefault(material, {}).setdefault(row, {})[path.stem] = document
    return found


def _section(material: str, rows: Mapping[str, Mapping[str, Any]]) -> str:
    tasks = [task for task in TASKS if any(task in row for row in rows.values())]
    lines = [
        f"## {material.replace('_', '-').capitalize()}",
        "",
        _line(["", *(task.replace("_", " ") for task in tasks)]),
    ]
    lines.append(_line(["---"] * (len(tasks) + 1)))
    known = [row for row in ROWS if row in rows]
    for row in (*known, *sorted(set(rows) - set(known))):
        lines.append(_line([ROWS.get(row, row.replace("_", " ")), *(_cell(rows[row].get(task)) for task in tasks)]))
    for name, errors in PAPER.get(material, {}).items():
        published = dict(zip(PAPER_TASKS, errors, strict=True))
        lines.append(_line([f"the paper's {name}", *(_number(published.get(task)) for task in tasks)]))
    lines += _floors(rows, tasks)
    return "\n".join(lines) + "\n"


def _floors(rows: Mapping[str, Mapping[str, Any]], tasks: Sequence[str]) -> list[str]:
    """What the analytic law itself differs by, in double precision and with half the time step."""
    words = {"float64": "analytic law, double precision", "half_step": "analytic law, half the time step"}
    lines = []
    for key, name in words.items():
        values = []
        for task in tasks:
            floors = [row[task].get("floor") for row in rows.values() if task in row]
            values.append(next((floor.get(key) for floor in floors if floor), None))
        if any(value is not None for value in values):
            lines.append(_line([name, *map(_number, values)]))
    return lines


def _cell(document: Mapping[str, Any] | None) -> str:
    if document is None:
        return ""
    stress = document.get("stress_error")
    diverged = sum(scene.get("mse") is None for scene in document["scenes"])
    note = f", {diverged} of {len(document['scenes'])} diverged" if diverged else ""
    return _number(document["mse"]) + (f" ({1e2 * stress:.2g} %)" if stress is not None else "") + note


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.1e}"


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def main() -> None:
    """The command."""
    if len(sys.argv) != 3:
        sys.exit("accepted: the folder of results and the page, docs/results/accuracy docs/results.md")
    folder, output = map(Path, sys.argv[1:])
    try:
        text = page(folder)
        with replaced_file(output) as part:
            part.write_text(text, encoding="utf-8")
    except UserError as fault:
        print(fault, file=sys.stderr)
        sys.exit(2)
    print(f"wrote {output}")


if __name__ == "__main__":
    main()
