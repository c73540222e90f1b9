"""The page that compares methods: ours, the baselines, and the analytic law, beside the paper's numbers."""

from collections.abc import Mapping
from pathlib import Path

from benchmarks.pages.cells import error, number, short, table, title, trained, words
from benchmarks.pages.comparison_picture import METHODS, draw_comparison
from benchmarks.pages.documents import Document, Results, Row, read_results
from benchmarks.pages.links import picture_link, relative
from benchmarks.pages.published import PAPER_MATERIALS, PAPER_TASKS, paper_mse
from benchmarks.pages.studies import trainings_section
from pcnclaws.atomic import replaced_file

PICTURE = Path("images") / "comparison.png"
NO_STRESS = "no stress"
HEADER = """# Comparison

Each method of [baselines.md](baselines.md) on the tasks of [evaluation.md](evaluation.md), all from the same data and
measured by the same code: mean squared position error [m²] (mean over particles, coordinates and every 5th step), in
brackets the relative error of the stress at the true states after contact. Written by `make tables` from the JSON files
in [{folder}]({folder}), which hold command, hardware, versions, commit and seed; `make baselines` makes them.

- All but -M are trained on one scene, `train-00`. *Reconstruction* is that scene, *long term* the same for twice as
  long, *geometry* six other shapes with its parameters; so they are for -M, which knows that scene among eleven others.
  *Unseen* are three objects of other parameters: a method that takes none predicts the one object that it knows.
- The paper's errors, below ours, are those of its own engine, motions and shapes; whether it sums or averages over the
  coordinates is not said. It has no stress errors and no times of a rollout.
- *Training* is the wall-clock time of iterations and checks on one thread (of the whole command where these were not
  noted), *rollout* that of the 500 steps of reconstruction. Other work on the machine is in both."""


def write_comparison(folder: Path, output: Path) -> list[Path]:
    """Writes the page and its picture; returns what was written.

    raises  UserError for a folder without results
    """
    results = read_results(folder)
    picture = draw_comparison(results, output.parent / PICTURE)
    with replaced_file(output) as part:
        part.write(comparison_page(results, folder, output.parent).encode())
    return [output, *([picture] if picture else [])]


def comparison_page(results: Results, folder: Path, base: Path) -> str:
    """The page in Markdown; folder of the results, base of the page, from which links start."""
    parts = [
        HEADER.format(folder=relative(folder, base)),
        f"!{picture_link('Error over time of all methods', base / PICTURE, base)}",
    ]
    for material in PAPER_MATERIALS:
        if results.get(material):
            parts += [f"## {title(material)}", material_table(material, results[material])]
    return "\n\n".join([*parts, *trainings_section(results)]) + "\n"


def material_table(material: str, rows: Mapping[str, Row]) -> str:
    """Methods by tasks, with the paper's errors below those of ours, and the times."""
    lines = []
    for name, label in METHODS.items():
        if name in rows:
            row = rows[name]
            cells = [_cell(row.tasks.get(task)) for task in PAPER_TASKS]
            lines.append([label, *cells, _training_minutes(row), _rollout(row)])
        paper = [number(paper_mse(material, name, task)) for task in PAPER_TASKS]
        if any(paper):
            lines.append([f"the paper's {label}", *paper, "", ""])
    return table(["", *map(words, PAPER_TASKS), "training [min]", "rollout [s]"], lines)


def _cell(document: Document | None) -> str:
    if document is None or document["mse"] is None or document.get("stress_error") is not None:
        return error(document)
    return f"{error(document)} ({NO_STRESS})"


def _training_minutes(row: Row) -> str:
    if row.training is None:
        return "none"
    seconds = trained(row, "training_seconds")
    return short((row.training["seconds"] if seconds is None else seconds) / 60.0)


def _rollout(row: Row) -> str:
    return short(row.tasks.get("reconstruction", {}).get("rollout_seconds"))
