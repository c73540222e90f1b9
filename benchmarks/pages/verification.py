"""The page of verification.

    python -m benchmarks.pages.verification docs/results/verification.json docs/verification.md

It is made of the result file of `python -m benchmarks problem=verification` alone, with its pictures.
"""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.charts import COLOURS, chart, decorate, save
from benchmarks.pages.cells import table
from benchmarks.pages.command import write_and_say
from benchmarks.pages.documents import read_document
from benchmarks.pages.links import picture_link
from pcnclaws.atomic import replaced_file

Row = Mapping[str, Any]
IMAGES = "images"
GROUPS = {
    "laws": "Laws at one point",
    "neural laws": "The laws that ship, at one point",
    "motion": "Motion",
    "not had": "Cases that cannot be had",
}
INTRODUCTION = """\
What must be true, our number, and the number of somebody else: a closed form, an independent program, a published
table. Written by `python -m benchmarks problem=verification` (`make tables` from {document}, which holds command,
hardware, versions, commit and seed). A row that leaves its tolerance fails a test, and so does one that is said to be
outside and comes back.

- *Difference* is relative: to their number, of curves and tables to the largest of theirs; of what should be 0 it is
  the number itself. Tolerances are round numbers of what the method promises on such a grid; no row was brought within
  by a wider one. Where coarser grids are outside (`wave_reflection`, the cantilevers), the tables show them.
- Laws are asked through the public interface in double precision, motions are `pc.Scene`s.
- {count}"""
HEADER = ("what must be true", "ours", "theirs", "difference", "tolerance", "", "source", "case")


def write_verification(document: Mapping[str, Any], output: Path, images: Path) -> list[Path]:
    """Writes the page and, into the folder `images`, a picture of each curve; returns what was written."""
    rows: Sequence[Row] = document["results"]["rows"]
    images.mkdir(parents=True, exist_ok=True)
    pictures = {row["name"]: draw_curve(row, images / f"{row['name']}.png") for row in rows if row.get("curve")}
    result = document["options"].get("document") or "verification.json"
    text = page(rows, pictures, output.parent, Path(result).name)
    with replaced_file(output) as part:
        part.write(text.encode())
    return [output, *pictures.values()]


def page(rows: Sequence[Row], pictures: Mapping[str, Path], base: Path, document: str) -> str:
    """The page in Markdown.

    pictures  by the name of the case
    base      folder of the page, from which links start
    """
    parts = ["# Verification", INTRODUCTION.format(document=f"`{document}`", count=_count(rows))]
    for group, title in GROUPS.items():
        of_group = [row for row in rows if row["group"] == group]
        if of_group:
            parts.append(f"## {title}")
            parts.append(_absent(of_group) if group == "not had" else _measured(of_group, pictures, base))
            parts += _beside(of_group, pictures, base)
    return "\n\n".join(parts) + "\n"


def draw_curve(row: Row, path: Path) -> Path:
    """Their lines, and ours as points on them."""
    figure, axis = chart(5.2, 3.4)
    lines = row["curve"]["lines"]
    for colour, line in zip(COLOURS * len(lines), lines, strict=False):
        name = f"{line['label']}: " if len(lines) > 1 else ""
        if line["theirs"]:
            axis.plot(
                line["x"], line["theirs"], color=colour, linewidth=1.2, label=f"{name}theirs" if not name else None
            )
        every = max(1, len(line["x"]) // 40)
        label = f"{name}ours" if not name else line["label"]
        axis.plot(
            line["x"][::every], line["ours"][::every], "o", color=colour, markersize=3, fillstyle="none", label=label
        )
    decorate(axis, row["curve"]["horizontal"], row["curve"]["vertical"])
    axis.set_title("" if len(lines) == 1 else "points: ours, lines: theirs", fontsize=8)
    axis.legend(fontsize=6 if len(lines) > 4 else 8)
    return save(figure, path)


def _count(rows: Sequence[Row]) -> str:
    verdicts = [row["verdict"] for row in rows]
    within, outside, missing = (verdicts.count(word) for word in ("within", "outside", "not had"))
    return (
        f"{within} of {within + outside} cases are within their tolerances, {outside} outside, each with its reason; "
        f"{missing} more cannot be had."
    )


def _measured(rows: Sequence[Row], pictures: Mapping[str, Path], base: Path) -> str:
    return table(HEADER, [_cells(row, pictures, base) for row in rows]) + "\n\n" + _commands(rows)


def _cells(row: Row, pictures: Mapping[str, Path], base: Path) -> list[str]:
    verdict = row["verdict"] if row["verdict"] == "within" else f"**{row['verdict']}**"
    name = f"`{row['name']}`"
    if row["name"] in pictures:
        name += f" {picture_link('curve', pictures[row['name']], base)}"
    numbers = [f"{row[which]:.6g} {row['unit']}".strip() for which in ("ours", "theirs")]
    bounds = [f"{row['difference']:.1e}", f"{row['tolerance']:.0e}"]
    cells = [row["sentence"], *numbers, *bounds, verdict, row["source"], name]
    return [cell.replace("|", "\\|") for cell in cells]


def _commands(rows: Sequence[Row]) -> str:
    """One command as an example: the others have their names in the last column."""
    return f"Each alone: `{rows[0]['command']}`, with the name of the last column."


def _absent(rows: Sequence[Row]) -> str:
    return table(
        ("what would have to be true", "why it cannot be had"), [[row["sentence"], row["why"]] for row in rows]
    )


def _beside(rows: Sequence[Row], pictures: Mapping[str, Path], base: Path) -> list[str]:
    """Reasons, and tables with their pictures, of the rows that have them."""
    parts = []
    outside = [row for row in rows if row["verdict"] == "outside"]
    if outside:
        reasons = [f"- `{row['name']}`: {row['why'] or 'no reason is known.'}" for row in outside]
        parts.append("Outside of their tolerances:\n\n" + "\n".join(reasons))
    for row in rows:
        if row.get("table"):
            parts.append(f"`{row['name']}`: {row['sentence']}")
            parts.append(table(row["table"]["header"], row["table"]["lines"]))
        if row["name"] in pictures and (row.get("table") or row["group"] == "motion"):
            parts.append(f"!{picture_link(row['sentence'], pictures[row['name']], base)}")
    return parts


def main() -> None:
    """The command."""
    if len(sys.argv) != 3:
        sys.exit("accepted: a result file and its page, docs/results/verification.json docs/verification.md")
    result, output = map(Path, sys.argv[1:])
    write_and_say(
        lambda: write_verification(
            read_document(result, "results", "python -m benchmarks problem=verification"),
            output,
            output.parent / IMAGES / "verification",
        )
    )


if __name__ == "__main__":
    main()
