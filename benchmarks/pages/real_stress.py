"""The page of measured stress: python -m benchmarks.pages.real_stress RESULT.json PAGE.md."""

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.pages.cells import table
from benchmarks.pages.command import write_and_say
from pcnclaws.atomic import replaced_file
from pcnclaws.errors import UserError
from pcnclaws.rendering.stress_curves import draw_stress_curves

# What is asked of a path that was trained on, and of one that was left out.
MOST_TRAINED, MOST_LEFT_OUT = 0.05, 0.10
FOAMS = ("leap", "turbo")
SCENES_FILE = "real_stress_scenes.json"
Row = Mapping[str, Any]
INTRODUCTION = """# Measured stress

`train data.stress=FILE` trains an elastic law on loading paths: deformation gradients, or stretches of some sides (the
others are free and solved for), with first Piola-Kirchhoff or Cauchy stress. This page trains the network
`model=pcnclaws_stretches` on the files in [measured](measured/README.md). It is written by `make tables` from
[real_stress.json](results/real_stress.json), which `python -m benchmarks.real_stress docs/measured
docs/results/real_stress.json` makes. Errors are relative: the root mean square of the error of the measured components
over that of what was measured, of each path.

    foam=docs/measured/foam/foam_leap
    python -m pcnclaws.train experiment=measured_foam "data.stress=[${foam}_UT.csv,${foam}_UC.csv]"
    python -m pcnclaws.train experiment=measured_rubbers data.stress=docs/measured/rubber/hyperelastic.h5

The law is the derivative of an energy that is a sum over the principal stretches, convex in their logarithms: stress
grows with strain in every direction, and no prior law says how ([training.md](training.md#measured-stress)). Beyond the
strains of a specimen, with a quarter of them as a margin, its stiffness stays what it is there.
"""
FOAM = """## Foams

A law a foam, from tension to a stretch of 1.3 and compression to 0.4. The sides were not measured; Poisson's ratio is
taken as 0. The last columns are laws of textbooks with E and the best nu from 0 to 0.45, fitted to the same two paths.
"""
SHEAR = """
### What they say of shear

Simple shear was not trained on. P12 [kPa] at a shear gamma, by the Poisson's ratio nu that is taken for the sides:
tension and compression fit with each (their errors are in the second column), and shear depends on it.
"""
RUBBER = """## Rubbers, a gel and brain tissue

One network for all specimens of the eight studies. A specimen has a Young's modulus, a scale of strain and two numbers
of shape, found along; the fit is made in the limit of incompressible bodies. *Left out* is the error of a path by a
training without it, from a fresh start; {left_out} of {paths} paths were left out in turn. Textbook laws are fitted to
each specimen by itself, all paths included.

Brain tissue is not described: its shear stiffens as if it had not been stretched before, which no energy that is a sum
over the stretches can say. Katashima's biaxial path has two unequal stresses at equal stretches, which no isotropic law
can have. The compression of Kawamura and a path of James contradict the other paths of their studies in the eyes of
this law.
"""
SCENES = """
## Simulated

`python -m benchmarks.real_stress_scenes` with the run folders of the two commands above
([json](results/real_stress_scenes.json)). A ball of the foam leap thrown on the floor at 6 m/s (its density is not
known; 200 kg/m^3 is taken): det F falls to {least:.2f}, {speed:.2f} of the speed come back, kinetic energy and that of
gravity never exceed those of the start. A sheet of the rubber of Meunier 2008 with nu = {ratio:g}, drawn out at both
ends at 1 m/s: its middle has the stretch {stretch:.2f} after {seconds:g} s, its sides {first:.2f} and {second:.2f}.

![Ball](images/real_stress_ball.png)

![Sheet](images/real_stress_sheet.png)"""


def page(found: Mapping[str, Any], scenes: Mapping[str, Any]) -> str:
    """The page in Markdown, from the results of the fits and of the simulations."""
    parts = [INTRODUCTION, FOAM, _foams(found), "\n![Foams](images/real_stress_foams.png)\n", SHEAR, _shear(found)]
    if "rubbers" in found:
        left_out = {
            name.removeprefix("without "): value["relative_rms"]
            for name, value in found.items()
            if name.startswith("without ") and value["relative_rms"] is not None
        }
        rows = found["rubbers"]["paths"]
        parts += [
            "\n" + RUBBER.format(left_out=len(left_out), paths=len(rows)),
            _verdict(rows, left_out),
            _rubbers(found["rubbers"], left_out),
            "\n![Rubbers](images/real_stress_rubbers.png)\n",
            _specimens(found["rubbers"]["specimens"]),
        ]
    ball, sheet = scenes["ball"], scenes["sheet"]
    first, second = sheet["sides_in_the_middle"]
    simulated = SCENES.format(
        least=ball["least_det_f"],
        speed=ball["speed_after_over_before"],
        ratio=sheet["poissons_ratio"],
        stretch=sheet["stretch_in_the_middle"],
        seconds=sheet["seconds"],
        first=first,
        second=second,
    )
    return "\n".join([*parts, simulated]) + "\n"


def _foams(found: Mapping[str, Any]) -> str:
    laws = list(found["foam leap"]["textbook"])
    lines = [
        [row["name"].removeprefix("foam_"), _percent(row["relative_rms"])]
        + [_percent(found[f"foam {foam}"]["textbook"][law][row["name"]]) for law in laws]
        for foam in FOAMS
        if f"foam {foam}" in found
        for row in found[f"foam {foam}"]["paths"]
    ]
    return table(["path", "learned", *laws], lines)


def _shear(found: Mapping[str, Any]) -> str:
    lines = [
        [foam, ratio, ", ".join(map(_percent, values["relative_rms"]))]
        + [f"{stress / 1e3:.0f}" for stress in values["stress"]]
        for foam in FOAMS
        if f"foam {foam}" in found
        for ratio, values in found[f"foam {foam}"]["simple_shear"].items()
    ]
    shears = found["foam leap"]["shear"]
    return table(["foam", "nu", "tension, compression", *(f"gamma = {shear:g}" for shear in shears)], lines)


def _verdict(rows: Sequence[Row], left_out: Mapping[str, float]) -> str:
    trained = sum(row["relative_rms"] <= MOST_TRAINED for row in rows)
    predicted = sum(error <= MOST_LEFT_OUT for error in left_out.values())
    beyond = [name for name, error in left_out.items() if error > MOST_LEFT_OUT]
    words = f" Beyond: {', '.join(beyond).replace('_', ' ')}." if beyond else ""
    return (
        f"Trained on, {trained} of {len(rows)} paths are within {100 * MOST_TRAINED:.0f} %; left out, {predicted} of "
        f"{len(left_out)} within {100 * MOST_LEFT_OUT:.0f} %.{words}\n"
    )


def _rubbers(rubbers: Mapping[str, Any], left_out: Mapping[str, float]) -> str:
    laws = rubbers["textbook"]
    lines = [
        [row["name"].replace("_", " "), _percent(row["relative_rms"]), _percent(left_out.get(row["name"]))]
        + [_percent(errors[row["name"]]) for errors in laws.values()]
        for row in rubbers["paths"]
    ]
    return table(["path", "learned", "left out", *laws], lines)


def _specimens(specimens: Sequence[Row]) -> str:
    lines = [
        [
            one["name"].replace("_", " "),
            f"{one['youngs_modulus'] / 1e3:.3g}",
            f"{one['scale']:.2f}",
            ", ".join(f"{number:.2f}" for number in one["shape"]),
        ]
        for one in specimens
    ]
    return table(["specimen", "E [kPa]", "scale of strain", "shape"], lines)


def _percent(share: float | None) -> str:
    return "" if share is None else f"{100.0 * share:.1f} %"


def write_page(source: Path, output: Path) -> list[Path]:
    """Writes the page, and its pictures in a folder beside it."""
    if not source.is_file():
        raise UserError(f"{source}: no such file; python -m benchmarks.real_stress makes it")
    found = json.loads(source.read_text(encoding="utf-8"))
    scenes = json.loads(source.with_name(SCENES_FILE).read_text(encoding="utf-8"))
    images = output.parent / "images"
    images.mkdir(exist_ok=True)
    foams = [{**row, "specimen": foam} for foam in FOAMS for row in found[f"foam {foam}"]["paths"]]
    written = [output, draw_stress_curves(foams, images / "real_stress_foams.png")]
    if "rubbers" in found:
        written.append(draw_stress_curves(found["rubbers"]["paths"], images / "real_stress_rubbers.png"))
    with replaced_file(output) as part:
        part.write(page(found, scenes).encode())
    return written


def main() -> None:
    """The command."""
    if len(sys.argv) != 3:
        sys.exit("accepted: a result file and its page, docs/results/real_stress.json docs/real_stress.md")
    source, output = map(Path, sys.argv[1:])
    write_and_say(lambda: write_page(source, output))


if __name__ == "__main__":
    main()
