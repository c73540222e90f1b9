"""The page of the unified law: python -m benchmarks.pages.unified docs/results docs/unified.md.

Made of <folder>/unified, and of the errors of the laws of one material each in <folder>/accuracy/<material>/short.
"""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import fmean, median

from benchmarks.pages.cells import number, percent, table
from benchmarks.pages.command import write_and_say
from benchmarks.pages.documents import Document, read_document
from benchmarks.pages.unified_words import BETWEEN, ERRORS, INTRODUCTION, SEEDS, SEEN, WHICH
from pcnclaws.atomic import replaced_file
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.laws.parameters import PARAMETERS

KINDS = ("elasticity", "plasticine", "sand")
# Objects of benchmarks/estimation.mk by their truth.
OBJECTS = {
    "elasticity_1": (1.8e5, 0.13),
    "elasticity_2": (1.4e5, 0.18),
    "elasticity_3": (2.0e5, 0.15),
    "plasticine_1": (4.7e5, 0.36, 4.2e3),
    "plasticine_2": (5.3e5, 0.31, 5.1e3),
    "plasticine_3": (4.2e5, 0.33, 5.7e3),
    "sand_1": (3.7e5, 0.18, 30.0),
    "sand_2": (4.2e5, 0.23, 26.0),
    "sand_3": (3.3e5, 0.20, 22.0),
}
TASKS = {
    "reconstruction": "training scenes",
    "unseen": "unseen objects",
    "geometry": "other shapes",
    "unseen_motion": "other motions",
}


# Of conf/experiment/unified_multi.yaml, what is not training=short.
RECIPE = ""


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
    unified = {scene["name"]: scene for scene in read_document(own / "unseen.json")["scenes"]}
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
    training = read_document(own / "training.json", "training", "train")
    how = {
        "iterations": training["training"]["iterations"],
        "recipe": RECIPE,
        "minutes": training["seconds"] / 60.0,
    }
    return [
        ERRORS.format(**how),
        table(["kind", "object", "unified", "alone", "ratio", "stress error"], lines),
        SEEDS.format(least=number(min(seeds)), most=number(max(seeds)), median=number(median(seeds))),
        table(["task", "MSE [m²]", "stress error"], [_task(own, task, words) for task, words in TASKS.items()]),
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
    parts = [WHICH]
    for seen, words in SEEN.items():
        every = {name: _documents(own / seen / name) for name in OBJECTS}
        found = {name: documents for name, documents in every.items() if documents}
        if found:
            lines = [_answer(name, documents) for name, documents in found.items()]
            right = sum(_answered(documents) == _kind(name) for name, documents in found.items())
            parts += [
                words,
                table(["object", *KINDS, "answer", "parameters found", "true"], lines),
                f"{right} of {len(lines)} are right.",
            ]
    return parts


def _kind(name: str) -> str:
    return name.rpartition("_")[0]


def _documents(folder: Path) -> dict[str, Document]:
    """The estimates by kind, empty where one of them is not there."""
    paths = {kind: folder / f"{kind}.json" for kind in KINDS}
    if not all(path.is_file() for path in paths.values()):
        return {}
    return {kind: read_document(path) for kind, path in paths.items()}


def _answered(documents: Mapping[str, Document]) -> str:
    return min(documents, key=lambda kind: documents[kind]["mse"])


def _answer(name: str, documents: Mapping[str, Document]) -> list[str]:
    answer = _answered(documents)
    residuals = [f"{1e3 * documents[kind]['mse'] ** 0.5:.3g}" for kind in KINDS]
    found = [_shown(one, value["estimate"]) for one, value in documents[answer]["parameters"].items()]
    truth = zip(MATERIALS[_kind(name)].parameter_names, OBJECTS[name], strict=True)
    true = [_shown(*one) for one in truth]
    return [name.replace("_", " "), *residuals, answer, ", ".join(found), ", ".join(true)]


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
