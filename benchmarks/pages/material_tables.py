"""The part of the page on one material: its laws on every task, beside the paper's errors and the floors."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from benchmarks.pages.cells import (
    ROWS,
    error,
    minutes,
    number,
    percent,
    row_name,
    short,
    table,
    title,
    trained,
    words,
)
from benchmarks.pages.documents import Row, tasks_of
from benchmarks.pages.links import picture_link
from benchmarks.pages.published import PAPER_MATERIALS, PAPER_ROWS, paper_mse

FLOORS = {"float64": "analytic law, double precision", "half_step": "analytic law, half the time step"}
# Rows of the sections that compare numbers of scenes, seeds and ways of training.
ELSEWHERE = ("scenes_", "seed_", "try_")


def material_section(material: str, rows: Mapping[str, Row], base: Path, level: int = 2) -> str:
    """Heading, tables and pictures of a material.

    base  folder of the page, from which links start
    """
    shown = shown_rows(rows)
    parts = [f"{'#' * level} {title(material)}", _errors_table(material, shown), *_own_scene(shown)]
    if any("unseen" in row.tasks for row in shown.values()):
        parts += ["On `unseen`, in other measures:", _measures_table(shown)]
    return "\n\n".join([*parts, *_pictures(material, shown, base)])


def shown_rows(rows: Mapping[str, Row]) -> dict[str, Row]:
    """The rows of the tables of a material, in their order."""
    known = [row for row in ROWS if row in rows]
    others = sorted(row for row in rows if row not in ROWS and not row.startswith(ELSEWHERE))
    return {row: rows[row] for row in (*known, *others) if rows[row].tasks}


def _errors_table(material: str, rows: Mapping[str, Row]) -> str:
    """Laws by tasks; the paper's errors stand below ours of the same kind."""
    tasks = tasks_of(rows)
    beside = PAPER_ROWS if material in PAPER_MATERIALS else {}
    lines = []
    for row in dict.fromkeys((*beside, *rows)):
        if row in rows:
            lines.append([row_name(row), *(error(rows[row].tasks.get(task)) for task in tasks)])
        if row in beside:
            lines.append([beside[row], *(number(paper_mse(material, row, task)) for task in tasks)])
    return table(["", *map(words, tasks)], [*lines, *_floors(rows, tasks)])


def _floors(rows: Mapping[str, Row], tasks: Sequence[str]) -> list[list[str]]:
    """What the analytic law itself differs by, in double precision and with half the time step."""
    lines = []
    for key, name in FLOORS.items():
        values = [floor(rows, task, key) for task in tasks]
        if any(value is not None for value in values):
            lines.append([name, *map(number, values)])
    return lines


def floor(rows: Mapping[str, Row], task: str, key: str) -> float | None:
    """The floor of a task: of a row that was evaluated on all its scenes, if there is one."""
    documents = sorted((row.tasks[task] for row in rows.values() if task in row.tasks), key=_is_of_one_scene)
    floors = [document["floor"] for document in documents if document.get("floor")]
    return floors[0].get(key) if floors else None


def _is_of_one_scene(document: Mapping[str, object]) -> bool:
    return document.get("scene") is not None


def _own_scene(rows: Mapping[str, Row]) -> list[str]:
    """What the row -S is measured on, where that is its own scene."""
    notes = []
    for name, row in rows.items():
        scenes = {task: row.tasks[task].get("scene") for task in tasks_of({name: row})}
        for scene in dict.fromkeys(filter(None, scenes.values())):
            tasks = ", ".join(words(task) for task, known in scenes.items() if known == scene)
            notes.append(
                f"{row_name(name)}: {tasks} in the scene that it was trained on (`{scene}`), or with its parameters."
            )
    return notes


def _measures_table(rows: Mapping[str, Row]) -> str:
    """The errors on `unseen` in other measures, and what the training took."""
    lines = []
    for name, row in rows.items():
        unseen = row.tasks.get("unseen", {})
        lines.append(
            [
                row_name(name),
                short(unseen.get("rms_percent"), " %"),
                percent(unseen.get("stress_error")),
                percent(unseen.get("energy_error")),
                number(trained(row, "validation_mse")),
                short(trained(row, "training_scenes")),
                minutes(row),
            ]
        )
    header = ["", "RMS of size", "stress error", "energy error", "validation MSE", "training scenes", "training [min]"]
    kept = [0, *(k for k in range(1, len(header)) if any(line[k] for line in lines))]
    return table([header[k] for k in kept], [[line[k] for k in kept] for line in lines])


def _pictures(material: str, rows: Mapping[str, Row], base: Path) -> list[str]:
    """The sheet of the unseen objects and the map of -M, and links to the other sheets."""
    parts = []
    if "multi" in rows:
        for task, kind, text in (
            ("unseen", "sheet", "true and predicted by -M, at parameters that it never saw"),
            ("outside_range", "map", "error of -M far outside the range of its training data"),
        ):
            path = rows["multi"].picture(task, kind)
            parts += [f"!{picture_link(f'{title(material)}: {text}', path, base)}"] if path else []
    links = [
        picture_link(f"{row_name(name)}, {words(task)}", path, base)
        for name, row in rows.items()
        for task in tasks_of({name: row})
        if (path := row.picture(task, "sheet"))
    ]
    return [*parts, f"Sheets, true and predicted side by side: {'; '.join(links)}."] if links else parts
