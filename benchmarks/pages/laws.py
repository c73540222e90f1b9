"""A page for each law that ships, from its card and its weights: python -m benchmarks.pages.laws docs/laws."""

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import pcnclaws as pc
from benchmarks.pages.command import write_and_say
from pcnclaws.atomic import replaced_file
from pcnclaws.commands.law_card import CARD
from pcnclaws.commands.runs import PRETRAINED, WEIGHTS
from pcnclaws.estimation.law_error import CALIBRATION


def write_pages(folder: Path) -> list[Path]:
    """Writes a page for each material whose weights ship; returns their paths."""
    paths = []
    for material in shipped():
        paths.append(folder / f"{material}.md")
        with replaced_file(paths[-1]) as part:
            part.write(law_page(material).encode())
    return paths


def shipped() -> list[str]:
    """The materials whose weights ship."""
    return sorted(path.parent.name for path in PRETRAINED.glob(f"*/{WEIGHTS}"))


def law_page(material: str) -> str:
    """The page of a law, in Markdown."""
    folder = PRETRAINED / material
    title, _, card = (folder / CARD).read_text(encoding="utf-8").partition("\n")
    return "\n".join(
        (
            f"<!-- written by python -m benchmarks.pages.laws docs/laws -->\n{title}",
            "",
            f'`law=pretrained material={material}` of the commands, `pc.load_law("{material}")` in Python; '
            f"`python -m pcnclaws.export law={material} output={material}.zip` [takes it along](../taking_along.md).",
            "",
            "## Training and errors",
            card.rstrip(),
            "",
            "More measurements: [results](../results.md), [comparison with other methods](../comparison.md).",
            "",
            "## Parameters",
            "",
            *_parameters(pc.load_law(material)),
            "",
            "Outside of the training range one line warns, and errors are not known.",
            "",
            "## What it is made of",
            "",
            *_laws(pc.load_law(material), folder),
            "",
        )
    )


def _parameters(law: pc.ConstitutiveModel) -> Iterator[str]:
    yield "| parameter | symbol | unit | trained from | to | accepted |"
    yield "|---|---|---|---|---|---|"
    for one in law.physical_parameters:
        low, high = law.ranges[one.name]
        yield f"| `{one.name}` | {one.glyph or one.symbol} | {one.unit} | {low:g} | {high:g} | {one.accepted} |"


def _laws(law: pc.ConstitutiveModel, folder: Path) -> Iterator[str]:
    truth = pc.analytic_law(law.material)
    for kind, own, learned in zip(("elastic", "plastic"), truth.laws, law.laws, strict=False):
        if own is None or learned is None:
            continue
        words = " ".join((type(learned).__doc__ or "").split("\n")[0].split())
        count = sum(weight.numel() for weight in learned.parameters())
        yield (
            f"- {kind.capitalize()} law: `{type(learned).__name__}`, {count} weights: {words} The truth of its data is "
            f"`{type(own).__name__}`."
        )
    yield f"- `{WEIGHTS}`: {(folder / WEIGHTS).stat().st_size} bytes, safetensors, single precision."
    if (folder / CALIBRATION).is_file():
        known = json.loads((folder / CALIBRATION).read_text(encoding="utf-8"))
        yield (
            f"- For [estimation](../estimation.md): its error moves markers by {known['law_error']:.1e} m, calibrated "
            f"on {known['objects']} objects (`python -m pcnclaws.calibrate material={law.material.name}`)."
        )


def main() -> None:
    """The command."""
    if len(sys.argv) != 2:
        sys.exit("name the folder of the pages: python -m benchmarks.pages.laws docs/laws")
    write_and_say(lambda: write_pages(Path(sys.argv[1])))


if __name__ == "__main__":
    main()
