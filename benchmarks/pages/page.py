"""Puts the page of results together."""

from pathlib import Path

from benchmarks.pages.documents import Results, read_results
from benchmarks.pages.links import picture_link, relative
from benchmarks.pages.material_tables import material_section, shown_rows
from benchmarks.pages.published import PAPER_MATERIALS
from benchmarks.pages.result_pictures import draw_accuracy, draw_training_scenes
from benchmarks.pages.studies import (
    positions_section,
    seeds_section,
    structure_section,
    training_scenes,
    training_scenes_section,
    trainings_section,
    variations_section,
)
from pcnclaws.atomic import replaced_file

IMAGES, ACCURACY, SCENES = "images", "accuracy.png", "training_scenes.png"
HEADER = """# Accuracy

Mean squared position error [m²] (mean over particles, coordinates and every 5th step), means over the scenes of a task;
in brackets the relative error of the stress at the true states after contact. The tasks and measures:
[evaluation.md](evaluation.md). Written by `make tables` from the JSON files in [{folder}]({folder}),
which hold command, hardware, versions, commit and seed.

- -M is one law of a material from several training scenes, -S one of a single scene. *Diverged*: the simulation with
  this law left the physical world; means are those of the scenes that did not.
- The truth is our analytic law in single precision, with the same step, grid and particles as the prediction: the
  error is that of the law. The last rows of a table say what the analytic law itself differs by when only its
  numerics change.
- The paper's errors are those of its own engine, motions, training scenes and shapes, for the nearest of our tasks. On
  `unseen` they are the mean of two objects, ours of the same two and a third. Whether it sums or averages over the
  coordinates is not said: the sum is three times our number. They are a mark, not a race."""
NEITHER = """## A law in neither family

Bodies of neo-Hookean elasticity and of Tresca plasticity, trained from positions only. The networks
were not built to contain either law."""


def write_page(folder: Path, output: Path) -> list[Path]:
    """Writes the page and its pictures, in a folder beside it; returns what was written.

    raises  UserError for a folder without results
    """
    results = read_results(folder)
    images = output.parent / IMAGES
    pictures = [
        draw_accuracy(results, images / ACCURACY),
        draw_training_scenes(training_scenes(results), images / SCENES),
    ]
    with replaced_file(output) as part:
        part.write(page(results, folder, output.parent).encode())
    return [output, *(picture for picture in pictures if picture)]


def page(results: Results, folder: Path, base: Path) -> str:
    """The page in Markdown.

    folder  of the results
    base    of the page, from which links start
    """
    parts = [HEADER.format(folder=relative(folder, base))]
    if any(row in results.get(material, {}) for material in PAPER_MATERIALS for row in ("multi", "single")):
        parts.append(f"!{picture_link('Our errors beside those of the paper', base / IMAGES / ACCURACY, base)}")
    sections = {
        material: material_section(material, results[material], base, 2 if material in PAPER_MATERIALS else 3)
        for material in (*PAPER_MATERIALS, *sorted(set(results) - set(PAPER_MATERIALS)))
        if shown_rows(results.get(material, {}))
    }
    parts += [text for material, text in sections.items() if material in PAPER_MATERIALS]
    parts += training_scenes_section(
        results, picture_link("Error against the number of training scenes", base / IMAGES / SCENES, base)
    )
    parts += [
        *seeds_section(results),
        *variations_section(results),
        *positions_section(results),
        *structure_section(results),
    ]
    others = [text for material, text in sections.items() if material not in PAPER_MATERIALS]
    parts += [NEITHER, *others] if others else []
    return "\n\n".join([*parts, *trainings_section(results)]) + "\n"
