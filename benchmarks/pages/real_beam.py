"""The page of the measured beam, from its results: python -m benchmarks.pages.real_beam JSON PAGE."""

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from benchmarks.pages.cells import table
from benchmarks.pages.command import write_and_say
from benchmarks.pages.documents import read_document
from benchmarks.pages.links import relative
from benchmarks.pages.real_beam_words import (
    BARS,
    CHOICE,
    CHOSEN,
    ERRORS,
    ESTIMATES,
    GRID,
    HEAVY,
    INTERVALS,
    INTRODUCTION,
    MODEL,
    RATIOS,
    SHEAR,
    STIFFENING,
    WHY,
)
from benchmarks.real_beam.report import draw_convergence, draw_motions
from pcnclaws.atomic import replaced_file

Row = Mapping[str, Any]
SHOWN = {
    "youngs_modulus": ("long-term E", 1e-3, "kPa"),
    "strength": ("first element over long-term modulus", 1.0, "-"),
    "exponent": ("exponent", 1.0, "-"),
    "release": ("release", 1e3, "ms"),
    "face": ("face of the clamp, z", 1e3, "mm"),
    "axis": ("axis of the beam, x", 1e3, "mm"),
    "held": ("held", 1e3, "mm"),
    "caught": ("caught", 1.0, "-"),
}
FITS = {"fit": "power law", "viscous_fit": "viscosity", "loaded_fit": "52 g, fitted afterwards"}
LAWS = {"viscosity": "viscosity", "even": "even loss factor", "power": "power law"}
MOTIONS = {
    "own weight, fitted": "bare",
    "**52 g, predicted**": "predicted",
    "52 g, predicted, release fitted": "aligned",
    "52 g, predicted, first turn read off": "turned",
    "52 g, fitted afterwards": "loaded",
}
FORMER = {words: f"{name}_viscous" for words, name in MOTIONS.items() if name != "loaded"}


def write_real_beam(document: Mapping[str, Any], page: Path, place: Path) -> list[Path]:
    """Writes the page, and its pictures into the folder `place`; returns what was written."""
    results = document["results"]
    pictures = [
        draw_motions(results, place / "motions.png"),
        draw_convergence(results, place / "convergence.png"),
    ]
    with replaced_file(page) as part:
        part.write(text_of(results, relative(place, page.parent)).encode())
    return [page, *pictures]


def text_of(results: Mapping[str, Any], place: str) -> str:
    """The page in Markdown; place: of the results, from the page."""
    simulated = results["simulated_with"]
    parts = [
        INTRODUCTION.format(place=place),
        MODEL.format(cells=simulated["cells"], nu=simulated["poissons_ratio"]),
        *_choice(results),
        *_estimates(results),
        *_prediction(results),
        _heavy(results, place),
        *_theory(results),
        *_grid(results, place),
    ]
    return "\n".join(part if part.endswith("\n") else f"{part}\n" for part in parts)


def _choice(results: Mapping[str, Any]) -> list[str]:
    rows: list[Row] = results["candidates"]
    lines = []
    for row in rows:
        known, motion = row["parameters"], row["moduli"]
        lines.append(
            [
                LAWS[row["law"]],
                f"{1e3 * known['held']['estimate']:.2f}" if row["held"] else "straight",
                f"{1e-3 * known['youngs_modulus']['estimate']:.0f}",
                f"{1e-3 * motion['0 g']['youngs_modulus']:.0f}",
                *(f"{motion[load]['loss_factor']:.3f}" for load in ("0 g", "52 g")),
                f"{1e3 * known['face']['estimate']:.1f}",
                f"{1e3 * row['rms']:.3f}",
            ]
        )
    head = ["law", "held [mm]", "E, long term [kPa]", "E at 7.73 Hz", "loss factor at 7.73 Hz", "at 4.35 Hz"]
    left = {(row["law"], row["held"]): 1e3 * row["rms"] for row in rows}
    motion = results["moduli"]["fit"]["0 g"]["youngs_modulus"]
    text = CHOSEN.format(
        **{law: left[law, True] for law in LAWS},
        chosen_straight=left["power", False],
        stiffer=motion / results["fit"]["parameters"]["youngs_modulus"]["estimate"] - 1.0,
    )
    return [CHOICE, table([*head, "face of the clamp [mm]", "left [mm]"], lines), text]


def _estimates(results: Mapping[str, Any]) -> list[str]:
    lines = [
        [f"{words} [{of}]", *(_interval(results[which]["parameters"].get(name), unit) for which in FITS)]
        for name, (words, unit, of) in SHOWN.items()
    ]
    grid, bare = _own(results)["damping"], results["bare"]
    text = INTERVALS.format(
        narrower=_narrower(results, "youngs_modulus"),
        narrower_strength=_narrower(results, "strength"),
        ours=bare["simulated"]["damping"],
        theirs=bare["measured"]["damping"],
        grid=grid,
        part=grid / bare["simulated"]["damping"],
    )
    return [ESTIMATES, table(["", *FITS.values()], lines), text, _stiffening(results)]


def _stiffening(results: Mapping[str, Any]) -> str:
    found = results["stiffening_fit"]
    share = found["parameters"]["stiffening"]
    low, high = share["interval_95"]
    return STIFFENING.format(
        left=1e3 * found["rms"], without=1e3 * results["fit"]["rms"], share=share["estimate"], low=low, high=high
    )


def _narrower(results: Mapping[str, Any], name: str) -> float:
    row = results["fit"]["parameters"][name]
    low, high = row["interval_95"]
    return 0.5 * (high - low) / row["white_noise_half"]


def _interval(row: Row | None, unit: float) -> str:
    if row is None:
        return ""
    low, high = row["interval_95"]
    return f"{unit * row['estimate']:.4g} ({unit * low:.4g} to {unit * high:.4g})"


def _prediction(results: Mapping[str, Any]) -> list[str]:
    lines = [_comparison(words, results[name]) for words, name in MOTIONS.items()]
    lines += [_comparison(f"{words}, with a viscosity", results[name]) for words, name in FORMER.items()]
    head = ["motion", "sag [mm], measured / ours", "", "frequency [Hz]", "", "damping", "RMS [mm]", ""]
    turned, slip, straight = results["turned"], results["clamp_slip"], results["predicted_straight"]["differences"]
    again, first = (results["moduli"][name]["52 g"] for name in ("loaded_fit", "fit"))
    young, own = (results[name]["parameters"]["youngs_modulus"]["estimate"] for name in ("loaded_fit", "fit"))
    why = WHY.format(
        young=young / own - 1.0,
        motion=again["youngs_modulus"] / first["youngs_modulus"] - 1.0,
        loss=again["loss_factor"] / first["loss_factor"],
        caught=turned["caught"],
        later=1e3 * turned["later"],
        straight_sag=straight["sag"],
        straight_frequency=straight["frequency"],
        slip=1e3 * slip["52 g"],
        slip_bare=1e3 * slip["0 g"],
    )
    return [BARS.format(turn=turned["turn"]), table(head, lines), why]


def _comparison(words: str, row: Row) -> list[str]:
    sag, rate, damping = (
        [row[which][name] for which in ("measured", "simulated")] for name in ("sag", "frequency", "damping")
    )
    off = row["differences"]
    return [
        words,
        f"{1e3 * sag[0]:.2f} / {1e3 * sag[1]:.2f}",
        f"{off['sag']:+.1%}{_missed(row, 'sag')}",
        f"{rate[0]:.2f} / {rate[1]:.2f}",
        f"{off['frequency']:+.1%}{_missed(row, 'frequency')}",
        f"{damping[0]:.3f} / {damping[1]:.3f}",
        f"{1e3 * row['rms']:.2f} of {1e3 * row['amplitude']:.2f}",
        f"{off['rms']:.0%}{_missed(row, 'rms')}",
    ]


def _missed(row: Row, name: str) -> str:
    return "" if row["met"][name] else " *missed*"


def _heavy(results: Mapping[str, Any], place: str) -> str:
    heavy = results["heavy"]
    low, high = sorted(-1e3 * heavy["curve"][edge][-1] for edge in ("low", "high"))
    return HEAVY.format(
        file=heavy["files"][0],
        band=heavy["files"][1],
        place=place,
        sag=1e3 * heavy["sag"],
        low=low,
        high=high,
        frequency=heavy["frequency"],
        damping=heavy["damping"],
        covered=results["coverage_of_loaded"],
    )


def _theory(results: Mapping[str, Any]) -> list[str]:
    theory, own, simulated = (results[name] for name in ("theory", "theory_of_simulated", "simulated_with"))
    ours, measured = _own(results), results["bare"]["measured"]
    softer = simulated["youngs_modulus"] / theory["youngs_modulus"]
    lines = [
        ["Euler-Bernoulli", f"{1e3 * theory['sag']:.2f}", f"{theory['frequency']:.2f}"],
        ["Timoshenko, nu 0.499", f"{1e3 * theory['sag_with_shear']:.2f}", ""],
        ["COMSOL, nu 0.499 (upper edge of the tip)", f"{1e3 * theory['comsol_sag']:.2f}", ""],
        [
            f"ours by scaling, nu {simulated['poissons_ratio']:g}, {simulated['cells']} cells",
            f"{1e3 * ours['sag'] * softer:.2f}",
            f"{ours['frequency'] / softer**0.5:.2f}",
        ],
        ["measured, first marker of the tip", f"{1e3 * measured['sag']:.2f}", f"{measured['frequency']:.2f}"],
    ]
    head = [f"own weight, E {1e-3 * theory['youngs_modulus']:.1f} kPa", "sag [mm]", "frequency [Hz]"]
    more = own["sag_with_shear"] / own["sag"] - 1.0
    return ["## Beside Euler-Bernoulli and COMSOL\n", table(head, lines), SHEAR.format(more=more)]


def _grid(results: Mapping[str, Any], place: str) -> list[str]:
    rows: Mapping[str, Row] = results["convergence"]
    lines = []
    for name, row in rows.items():
        cells, load = name.split(" cells, ")
        lines.append([load, cells, f"{30.0 / int(cells):.2f}", *_figures(row)])
    ratios: Mapping[str, Row] = results["poissons_ratios"]
    finest = max(int(name.split()[0]) for name in rows)
    bare, loaded = ({k: _row(rows, k, load) for k in (results["simulated_with"]["cells"], finest)} for load in LOADS)
    sag, ratio = (values[finest]["sag"] / next(iter(values.values()))["sag"] for values in (bare, loaded))
    frequency = bare[finest]["frequency"] / next(iter(bare.values()))["frequency"]
    products = [row["sag"] * row["frequency"] ** 2 for row in ratios.values()]
    last = max(ratios)
    return [
        GRID.format(young=1e-3 * results["simulated_with"]["youngs_modulus"]),
        table(["weight", "cells over the width", "dx [mm]", *FIGURES], lines),
        f"![Convergence]({place}/convergence.png)",
        ERRORS.format(sag=sag - 1.0, frequency=frequency - 1.0, ratio=abs(ratio / sag - 1.0)),
        table(["nu", *FIGURES], [[name.removeprefix("nu "), *_figures(row)] for name, row in ratios.items()]),
        RATIOS.format(
            cells=results["cells_of_ratios"],
            nu=float(last.removeprefix("nu ")),
            change=ratios[last]["sag"] / ratios[min(ratios)]["sag"] - 1.0,
            product=max(products) / min(products) - 1.0,
            used=results["simulated_with"]["poissons_ratio"],
        ),
    ]


LOADS = ("0 g", "52 g")
FIGURES = ("sag [mm]", "frequency [Hz]", "damping")


def _figures(row: Row) -> list[str]:
    return [f"{1e3 * row['sag']:.3f}", f"{row['frequency']:.3f}", f"{row['damping']:.4f}"]


def _row(rows: Mapping[str, Row], cells: int, load: str) -> Row:
    return rows[f"{cells} cells, {load}"]


def _own(results: Mapping[str, Any]) -> Row:
    """The bare beam without Maxwell elements on the grid of the fit."""
    return _row(results["convergence"], results["simulated_with"]["cells"], LOADS[0])


def main() -> None:
    """The command."""
    if len(sys.argv) != 3:
        sys.exit("accepted: a result file and its page, docs/results/real_beam/real_beam.json docs/real_beam.md")
    result, page = map(Path, sys.argv[1:])
    write_and_say(
        lambda: write_real_beam(
            read_document(result, "results", "python -m benchmarks problem=real_beam"), page, result.parent
        )
    )


if __name__ == "__main__":
    main()
