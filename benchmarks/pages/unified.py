"""The page of the unified law: python -m benchmarks.pages.unified docs/results docs/unified.md.

Made of <folder>/unified, and of the errors of the laws of one material each in <folder>/accuracy/<material>/short.
"""

import sys
from collections.abc import Sequence
from pathlib import Path
from statistics import fmean, median

from benchmarks.pages.cells import number, percent, table
from benchmarks.pages.command import write_and_say
from benchmarks.pages.documents import Document, read_document
from benchmarks.pages.unified_words import (
    BETWEEN,
    ERRORS,
    INTRODUCTION,
    OTHER_TASKS,
    SEEDS,
    SEEN,
    SEEN_WITH_NOISE,
    WHICH,
)
from benchmarks.which_material import KINDS, MARKERS, answer
from pcnclaws.atomic import replaced_file
from pcnclaws.laws.parameters import PARAMETERS

TASKS = {
    "reconstruction": "training scenes",
    "geometry": "other shapes",
    "unseen_motion": "other motions",
}


def write_page(folder: Path, output: Path) -> list[Path]:
    """Writes the page; returns its path. UserError for a file that is missing."""
    with replaced_file(output) as part:
        part.write(page(folder).encode())
    return [output]


def page(folder: Path) -> str:
    """The page in Markdown."""
    own = folder / "unified"
    parts = [INTRODUCTION, *_errors(folder, own), *_between(own), *_which(own)]
    return "\n\n".join(parts) + "\n"


def _errors(folder: Path, own: Path) -> list[str]:
    """The errors of each kind beside those of the laws of one material each."""
    training = read_document(own / "training.json", "training", "train")
    unified = {scene["name"]: scene for scene in training["scenes"]}
    lines = []
    for kind in KINDS:
        row = folder / "accuracy" / kind / "short" / "unseen.json"
        alone = {scene["name"]: scene["mse"] for scene in read_document(row)["scenes"]}
        for name, error in alone.items():
            one = unified[name]
            lines.append([kind, f"`{name}`", *_pair(one["mse"], error), percent(one["stress_error"])])
        means = (fmean(unified[name]["mse"] for name in alone), fmean(alone.values()))
        lines.append([f"**{kind}**", "mean", *_pair(*means), ""])
    of_sand = folder / "accuracy" / "sand"
    seeds = [read_document(path)["mse"] for path in of_sand.glob("seed_*/unseen.json")]
    seeds.append(read_document(of_sand / "short" / "unseen.json")["mse"])
    how = {
        "iterations": training["training"]["iterations"],
        "minutes": training["seconds"] / 60.0,
    }
    tasks = {task: words for task, words in TASKS.items() if (own / f"{task}.json").is_file()}
    return [
        ERRORS.format(**how),
        table(["kind", "object", "unified", "alone", "ratio", "stress error"], lines),
        SEEDS.format(least=number(min(seeds)), most=number(max(seeds)), median=number(median(seeds))),
        *(
            [OTHER_TASKS, table(["task", "MSE [m²]", "stress error"], [_task(own, *one) for one in tasks.items()])]
            if tasks
            else []
        ),
    ]


def _pair(unified: float | None, alone: float) -> list[str]:
    if unified is None:
        return ["diverged", number(alone), ""]
    return [number(unified), number(alone), f"{unified / alone:.1f}"]


def _task(own: Path, task: str, words: str) -> list[str]:
    document = read_document(own / f"{task}.json")
    lost = sum(scene["mse"] is None for scene in document["scenes"])
    return [words + (f" ({lost} diverged)" if lost else ""), number(document["mse"]), percent(document["stress_error"])]


def _between(own: Path) -> list[str]:
    document = read_document(own / "between_kinds.json", "results", "benchmarks")
    rows: dict[tuple[float, ...], list[Document]] = {}
    for row in document["results"]["rows"]:
        rows.setdefault(tuple(row["shares"]), []).append(row)
    lines = [
        [
            *(f"{share:g}" for share in shares),
            *(_worst(some, law, "growth") for law in ("analytic", "learned")),
            _worst(some, "learned", "mse"),
        ]
        for shares, some in rows.items()
    ]
    return [
        BETWEEN.format(steps=document["options"]["steps"]),
        table(["plasticine", "sand", "energy, analytic", "energy, learned", "learned, MSE [m²]"], lines),
    ]


def _worst(rows: Sequence[Document], law: str, name: str) -> str:
    of_law = [row for row in rows if row["law"] == law]
    if not all(row["finite"] for row in of_law):
        return "diverged"
    return f"{max(row[name] for row in of_law):{'.1e' if name == 'mse' else '.4f'}}"


def _which(own: Path) -> list[str]:
    document = read_document(own / "which_material.json", "results", "benchmarks")
    options = document["options"]
    parts = [WHICH.format(**{name: options[name] for name in ("steps", "screening", "iterations")})]
    for noise in options["noise"]:
        rows = [row for row in document["results"]["rows"] if row["noise"] == noise]
        right = sum(answer(row) == row["kind"] for row in rows)
        frames = options["steps"] // options["every"] + 1
        parts += [
            (SEEN_WITH_NOISE if noise else SEEN).format(frames=frames, noise=1e3 * noise, markers=MARKERS),
            table(
                ["object", *(f"as {kind}" for kind in KINDS), "answer", "parameters found"],
                [_answer(row) for row in rows],
            ),
            f"{right} of {len(rows)} are right.",
        ]
    return parts


def _answer(row: Document) -> list[str]:
    explained, found = row["explained"], answer(row)
    residuals = [f"{1e3 * explained[kind]['mse'] ** 0.5:.2g}" for kind in KINDS]
    values = [_shown(*one) for one in explained[found]["parameters"].items()]
    true = [_shown(*one) for one in row["truth"].items()]
    return [f"{row['kind']}: {', '.join(true)}", *residuals, found, ", ".join(values)]


def _shown(name: str, value: float | None) -> str:
    if value is None:
        return f"{PARAMETERS[name].glyph or PARAMETERS[name].symbol} cannot be told"
    parameter = PARAMETERS[name]
    unit = parameter.shown_unit if parameter.shown_unit in ("", "°") else f" {parameter.shown_unit}"
    return f"{parameter.glyph or parameter.symbol} {value * parameter.display_factor:.4g}{unit}"


def main() -> None:
    """The command."""
    if len(sys.argv) != 3:
        sys.exit("name the results and the page: python -m benchmarks.pages.unified docs/results docs/unified.md")
    write_and_say(lambda: write_page(Path(sys.argv[1]), Path(sys.argv[2])))


if __name__ == "__main__":
    main()
