"""What the recordings say: fits, which law they choose, comparisons, and the prediction. Simulations are rows."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.real_beam.band import GOES_ON, HEAVY, LET_GO, Known, coverage, trend, with_band, write_prediction
from benchmarks.real_beam.fit import Fit, fit, start_of
from benchmarks.real_beam.law import RELAXATION_TIMES, VISCOUS, complex_modulus, strengths
from benchmarks.real_beam.measured import GRAVITY_FILE, LOADED_FILE, Recording, clamp_moved, read
from benchmarks.real_beam.prediction import (
    LOADED,
    comparison,
    figures,
    from_first_turn,
)
from benchmarks.real_beam.runs import FIRST_GUESS, POISSON, tips
from benchmarks.real_beam.surrogate import Family

PREDICTED = "predicted_101g.csv"
# Laws of the first simulations: long-term E [Pa], strength and exponent of the Maxwell elements [-].
START, START_VISCOUS = (2.44e5, 0.285, 0.274), (3.04e5, 1.3, VISCOUS)
# What a fit always estimates beside the law; batches of simulations that are asked for here.
PLACE, BATCHES = ("release", "face", "axis"), 4
LAW, VISCOUS_LAW = ("youngs_modulus", "strength", "exponent"), ("youngs_modulus", "strength")
# Laws that are tried on the first recording: the exponent they begin with, and what of it is estimated.
EVEN, POWER = 0.0, 0.3
# Frequencies of the recordings [Hz].
RUNG = {0.0: 7.73, LOADED: 4.35}
CANDIDATES = {
    "viscosity": ((3.0e5, 1.3, VISCOUS), VISCOUS_LAW),
    "even": ((2.2e5, 0.12, EVEN), VISCOUS_LAW),
    "power": ((2.5e5, 0.3, POWER), LAW),
}

Rows = Callable[[str, Callable[[], Any]], Any]


def conclusions(row: Rows, folder: Path, seed: int) -> dict[str, Any]:
    """All but the studies of grid and Poisson's ratio; the prediction's files go into the folder.

    row  the row of a name: the stored one, or what the function makes
    """
    bare_file, loaded_file = read(GRAVITY_FILE), read(LOADED_FILE)
    bare, unseen = _own_weight(row, bare_file)
    loaded, heavy = _loaded(row, bare, unseen, loaded_file)
    straight, unseen_viscous = _viscous(row, bare_file)
    return {
        **_motions(bare, unseen, loaded_file, ""),
        **_motions(straight, unseen_viscous, loaded_file, "_viscous"),
        "candidates": _candidates(bare_file, {"viscosity": straight.family, "even": bare.family, "power": bare.family}),
        "predicted_straight": _predicted_straight(bare, unseen, loaded_file),
        "fit": bare.fit.plain(),
        "stiffening_fit": _fitted(bare_file, bare.family, (*LAW, "held", "stiffening"), _law(bare.fit)).plain(),
        "viscous_fit": straight.fit.plain() | {"viscosity": _viscosity(straight.fit)},
        "loaded_fit": loaded.fit.plain(),
        "loaded": comparison(loaded_file, loaded.family, loaded.fit.values, LOADED),
        "moduli": {"fit": _moduli(bare.fit), "viscous_fit": _moduli(straight.fit), "loaded_fit": _moduli(loaded.fit)},
        "clamp_slip": {"0 g": bare_file.clamp_slip, "52 g": loaded_file.clamp_slip},
        "heavy": _heavy(bare, loaded, heavy, folder, seed),
        "coverage_of_loaded": coverage(bare, loaded, seed),
    }


def _own_weight(row: Rows, recording: Recording) -> tuple[Known, Family]:
    """The fit around a simulation at its estimate, and the simulation of the loaded beam with the same law."""
    early = row("first simulation", partial(tips, {"0 g": (0.0, START)}))
    law = _law(_fitted(recording, Family(early["0 g"]), (*LAW, "held"), START))
    both = row("at the estimate", partial(tips, {"0 g": (0.0, law), "52 g": (LOADED, law)}))
    family = Family(both["0 g"])
    return Known(recording, _fitted(recording, family, (*LAW, "held"), law), family), Family(both["52 g"])


def _loaded(row: Rows, bare: Known, unseen: Family, recording: Recording) -> tuple[Known, Family]:
    """The loaded recording fitted afterwards, around a simulation at its estimate, and one of the heaviest weight."""
    rough = Known(recording, _afterwards(recording, unseen, _carried(bare, recording)), unseen)
    ahead = trend(bare, rough, HEAVY, float(np.mean(GOES_ON))), *_law(rough.fit)[1:]
    rows = row("loaded", partial(tips, {"52 g": (LOADED, _law(rough.fit)), "101 g": (HEAVY, ahead)}))
    family = Family(rows["52 g"])
    return Known(recording, _afterwards(recording, family, rough.fit.values), family), Family(rows["101 g"])


def _viscous(row: Rows, recording: Recording) -> tuple[Known, Family]:
    """The same with a viscosity alone, let go from straight."""
    rows = row("with a viscosity", partial(tips, {"0 g": (0.0, START_VISCOUS), "52 g": (LOADED, START_VISCOUS)}))
    family = Family(rows["0 g"])
    return Known(recording, _fitted(recording, family, VISCOUS_LAW, START_VISCOUS), family), Family(rows["52 g"])


def _fitted(recording: Recording, family: Family, free: tuple[str, ...], law: tuple[float, float, float]) -> Fit:
    return fit(recording, family, start_of(recording, law), (*free, *PLACE))


def _afterwards(recording: Recording, family: Family, start: np.ndarray) -> Fit:
    """All that there is, from the loaded recording."""
    return fit(recording, family, start, (*LAW, *PLACE, "held", "caught"))


def _law(found: Fit) -> tuple[float, float, float]:
    modulus, strength, exponent = found.values[:3].tolist()
    return modulus, strength, exponent


def _carried(bare: Known, recording: Recording) -> np.ndarray:
    """What the prediction knows of its recording: where its markers start, and when they start to move."""
    carried = bare.fit.values.copy()
    carried[3] = recording.onset
    carried[4:6] += clamp_moved(bare.recording, recording)[[2, 0]]
    return carried


def _motions(bare: Known, family: Family, recording: Recording, end: str) -> dict[str, Any]:
    """The fitted motion; the next one as predicted, with its release fitted, and with its first turn read off."""
    carried = _carried(bare, recording)
    aligned = fit(recording, family, carried, ("release",)).values
    turned = from_first_turn(recording, family, carried)
    return {
        f"bare{end}": comparison(bare.recording, bare.family, bare.fit.values, 0.0),
        f"predicted{end}": comparison(recording, family, carried, LOADED),
        f"aligned{end}": comparison(recording, family, aligned, LOADED),
        f"turned{end}": comparison(recording, family, turned, LOADED)
        | {
            "turn": recording.first_turn[0] - recording.onset,
            "later": float(turned[3] - recording.onset),
            "caught": float(turned[7]),
        },
    }


def _candidates(recording: Recording, families: Mapping[str, Family]) -> list[dict[str, Any]]:
    """What each law leaves of the first recording, let go from straight and from where it was held.

    families  around whose simulations, by law
    """
    rows = []
    for law, (start, free) in CANDIDATES.items():
        for held in ((), ("held",)):
            found = _fitted(recording, families[law], (*free, *held), start)
            rows.append({"law": law, "held": bool(held), **found.plain(), "moduli": _moduli(found)})
    return rows


def _predicted_straight(bare: Known, family: Family, recording: Recording) -> dict[str, Any]:
    """The prediction of the same law, had the tip been taken to hang straight before the release."""
    found = _fitted(bare.recording, bare.family, LAW, _law(bare.fit))
    carried = _carried(Known(bare.recording, found, bare.family), recording)
    return comparison(recording, family, carried, LOADED)


def _moduli(found: Fit) -> dict[str, dict[str, float]]:
    """E in motion [Pa] and loss factor [-] at the frequencies of the two recordings."""
    modulus, strength, exponent = _law(found)
    rows = {}
    for name, weight in (("0 g", 0.0), ("52 g", LOADED)):
        ratio = complex_modulus(strengths(strength, exponent), RUNG[weight])
        rows[name] = {"youngs_modulus": modulus * ratio.real, "loss_factor": ratio.imag / ratio.real}
    return rows


def _viscosity(found: Fit) -> float:
    """Of shear [Pa s], of the first element alone; nu is that of the simulations."""
    modulus, strength, _ = _law(found)
    return modulus / (2.0 + 2.0 * POISSON) * strength * RELAXATION_TIMES[0]


def _heavy(bare: Known, loaded: Known, family: Family, folder: Path, seed: int) -> dict[str, Any]:
    """The prediction for the heaviest weight, whose files are written."""
    heavy = with_band(bare, loaded, family, HEAVY, seed)
    written = write_prediction(heavy, folder / PREDICTED)
    height = {name: heavy[name][:, 0, 0] - heavy["middle"][0, 0, 0] for name in ("middle", "low", "high")}
    curve = {name: np.round(one, 7).tolist() for name, one in height.items()}
    return figures(height["middle"], heavy["time"], LET_GO, FIRST_GUESS[HEAVY]) | {
        "files": [path.name for path in written],
        "curve": {"time": heavy["time"].tolist(), **curve},
    }
