"""The parts of the page that compare laws over all materials. Each is empty where there is nothing to compare."""

from collections.abc import Mapping, Sequence
from statistics import fmean

from benchmarks.pages.cells import error, minutes, number, percent, row_name, short, table, title, trained, words
from benchmarks.pages.documents import Document, Results, Row, tasks_of
from benchmarks.pages.published import PAPER_MATERIALS

SCENES, SEED, VARIATION = "scenes_", "seed_", "try_"
# The row that the others of a study differ from in one thing alone: 12 scenes, seed 0.
REFERENCE, STANDARD_SCENES = "quick", 12
# That of other seeds.
FIRST_SEED = "short"
# Tasks of the tables that compare a few laws.
COMPARED = ("unseen", "geometry", "unseen_motion", "long_term")


# Iterations of trainings that the clock ends.
NOBODY_REACHES = 1_000_000


def training_scenes(results: Results) -> dict[str, dict[int, Document]]:
    """Material -> number of training scenes -> errors on `unseen`, of materials with at least two numbers."""
    found: dict[str, dict[int, Document]] = {}
    for material, rows in results.items():
        counted = {int(name.removeprefix(SCENES)): row for name, row in rows.items() if _is_counted(name, SCENES)}
        if REFERENCE in rows:
            counted[int(trained(rows[REFERENCE], "training_scenes") or STANDARD_SCENES)] = rows[REFERENCE]
        known = {count: row.tasks["unseen"] for count, row in sorted(counted.items()) if "unseen" in row.tasks}
        if len(known) > 1:
            found[material] = known
    return found


def training_scenes_section(results: Results, picture: str) -> list[str]:
    """Error on `unseen` against the number of training scenes; picture: the link to its drawing."""
    found = training_scenes(results)
    if not found:
        return []
    counts = sorted({count for known in found.values() for count in known})
    lines = [[str(count), *(error(known.get(count)) for known in found.values())] for count in counts]
    text = "Error on `unseen` of laws that were trained on so many scenes, all else as with `training=keyframes`."
    return ["## Training scenes", text, f"!{picture}", table(["scenes", *map(words, found)], lines)]


def seeds_section(results: Results) -> list[str]:
    """The same training from other random numbers, with mean and spread."""
    parts = []
    for material, rows in results.items():
        seeds = {name: row for name, row in rows.items() if name == FIRST_SEED or _is_counted(name, SEED)}
        if len(seeds) > 1:
            parts += [f"{title(material)}, MSE [m²]:", _seeds_table(seeds)]
    text = "The short training again from other seeds, which draw the start of the networks and the order of the data."
    return ["## Seeds", text, *parts] if parts else []


def _seeds_table(seeds: Mapping[str, Row]) -> str:
    tasks = tasks_of(seeds)
    columns = [[row.tasks[task]["mse"] for row in seeds.values() if task in row.tasks] for task in tasks]
    lines = [[_seed_name(name), *(_mse(row.tasks.get(task)) for task in tasks)] for name, row in seeds.items()]
    whole = [len(column) > 1 and None not in column for column in columns]
    means = [number(fmean(column)) if known else "" for column, known in zip(columns, whole, strict=True)]
    spreads = [
        short(max(column) / min(column)) if known and min(column) > 0.0 else ""
        for column, known in zip(columns, whole, strict=True)
    ]
    return table(["", *map(words, tasks)], [*lines, ["mean", *means], ["largest over smallest", *spreads]])


def variations_section(results: Results) -> list[str]:
    """One thing of a training changed: error on `unseen`, material by material."""
    names = sorted({row for rows in results.values() for row in rows if row.startswith(VARIATION)})
    if not names:
        return []
    materials = [material for material, rows in results.items() if any(row.startswith(VARIATION) for row in rows)]
    lines = [
        [
            "as it is" if name == REFERENCE else name.removeprefix(VARIATION).replace("_", " "),
            *(cell for material in materials for cell in _variation_cells(results[material].get(name))),
        ]
        for name in (REFERENCE, *names)
    ]
    header = ["", *(word for material in materials for word in (words(material), "training [min]"))]
    text = "`training=keyframes` with one thing changed, of the same number of simulated steps: MSE [m²] on `unseen`."
    return ["## Ways of training", text, table(header, lines)]


def _variation_cells(row: Row | None) -> tuple[str, str]:
    return ("", "") if row is None else (error(row.tasks.get("unseen")), minutes(row))


def positions_section(results: Results) -> list[str]:
    """Training from positions alone beside training from recorded full states."""
    text = (
        "-M restarts its segments from recorded full states (keyframes): position, velocity, affine velocity, "
        "elastic deformation. *Positions only* sees the positions of the frames and the state at the start alone."
    )
    return _compared(results, "## Positions only beside keyframes", text, ("multi", "multi_positions"))


def structure_section(results: Results) -> list[str]:
    """What the form of the law knows before it learns, and what it learns without that form."""
    text = (
        "*Structure alone* is the law before its first iteration. *Without the prior* the law does not start from the "
        "Hencky law, nor does it know what the moduli mean. The last column is the MSE on `unseen` over that of -M."
    )
    rows = ("structure", "no_prior", "multi_paper", "multi")
    return _compared(results, "## What does the structure, what the learning", text, rows, factor=True)


def trainings_section(results: Results) -> list[str]:
    """The command, the time and the hardware of every training."""
    lines = [
        [words(material), row_name(name), *_training_cells(row, row.training)]
        for material, rows in results.items()
        for name, row in rows.items()
        if row.training
    ]
    header = ["material", "law", "command", "iterations", "validation MSE", "minutes", "processor", "commit"]
    text = (
        "Minutes are those of the whole command, its test and pictures included; data that was there already is not, "
        "nor is what was done before an interruption. Commands without `training=` are of commits at which "
        "`training=keyframes` was the default, but for those of the short training and its seeds."
    )
    return ["## Trainings", text, table(header, lines)] if lines else []


def _compared(results: Results, heading: str, text: str, rows: Sequence[str], factor: bool = False) -> list[str]:
    """A table of the rows for each of the paper's materials that has more of them than -M."""
    chosen = {
        material: {row: results[material][row] for row in rows if row in results[material]}
        for material in PAPER_MATERIALS
        if material in results
    }
    chosen = {material: some for material, some in chosen.items() if set(some) - {"multi"}}
    if not chosen:
        return []
    tasks = [task for task in COMPARED if any(task in row.tasks for some in chosen.values() for row in some.values())]
    header = ["material", "law", *map(words, tasks), "RMS of size", "energy error", "training [min]"]
    lines = [
        [words(material), row_name(name), *_compared_cells(row, tasks), *([_factor(row, some)] if factor else [])]
        for material, some in chosen.items()
        for name, row in some.items()
    ]
    return [heading, text, table([*header, *(["times -M"] if factor else [])], lines)]


def _compared_cells(row: Row, tasks: Sequence[str]) -> list[str]:
    unseen = row.tasks.get("unseen", {})
    errors = [error(row.tasks.get(task)) for task in tasks]
    return [*errors, short(unseen.get("rms_percent"), " %"), percent(unseen.get("energy_error")), minutes(row)]


def _factor(row: Row, rows: Mapping[str, Row]) -> str:
    """MSE on `unseen` over that of -M."""
    own, multi = (one.tasks.get("unseen", {}).get("mse") if one else None for one in (row, rows.get("multi")))
    return short(float(f"{own / multi:.2g}")) if own is not None and multi else ""


def _training_cells(row: Row, training: Document) -> list[str]:
    origin = training.get("provenance", {})
    threads = origin.get("threads")
    return [
        f"`{str(origin.get('command', '')).replace('|', '/')}`",
        _iterations(row),
        number(trained(row, "validation_mse")),
        minutes(row),
        str(origin.get("processor", "")) + (f", {threads} thread{'' if threads == 1 else 's'}" if threads else ""),
        str(origin.get("commit") or "")[:8],
    ]


def _iterations(row: Row) -> str:
    """How many were done; older results of trainings that the clock ended hold the number that nobody reaches."""
    count = trained(row, "iterations")
    return "by the clock" if count is not None and count >= NOBODY_REACHES else short(count)


def _is_counted(name: str, prefix: str) -> bool:
    return name.startswith(prefix) and name.removeprefix(prefix).isdecimal()


def _seed_name(row: str) -> str:
    return "seed 0" if row == FIRST_SEED else row.replace("_", " ")


def _mse(document: Document | None) -> str:
    """The MSE alone."""
    return "" if document is None else error({**document, "stress_error": None})
