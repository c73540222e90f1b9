"""The measured beam: its law, its fit on made-up recordings, and the page that is made of the results."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch

from benchmarks.pages.real_beam import text_of
from benchmarks.real_beam.fit import NAMES, REGISTRATION, fit, simulated, start_of
from benchmarks.real_beam.law import Following, Silicone
from benchmarks.real_beam.measured import GRAVITY_FILE, LOADED_FILE, Recording, read
from benchmarks.real_beam.problem import LAW
from benchmarks.real_beam.runs import SOFTER, VISCOSITIES, YOUNG, plain
from benchmarks.real_beam.scene import LENGTH, Tip
from benchmarks.real_beam.surrogate import Family
from pcnclaws.laws.formulas import TIME_STEP

DOCS = Path(__file__).parents[2] / "docs"


def test_in_steady_shear_the_stress_is_that_of_a_newtonian_viscosity() -> None:
    rate, viscosity, step, steps = 0.5, 200.0, 1e-4, 300
    known = {
        name: torch.tensor([value], dtype=torch.float64)
        for name, value in {"youngs_modulus": 3e5, "poissons_ratio": 0.45, "viscosity": viscosity}.items()
    } | {"relaxation_time": torch.tensor([2e-3], dtype=torch.float64), TIME_STEP: torch.tensor([step]).double()}
    internal = {one.name: torch.zeros(1, dtype=torch.float64) for one in Following.internal_variables}
    deformation = torch.eye(3, dtype=torch.float64)[:, :, None].clone()
    for k in range(steps):
        deformation[0, 1] = rate * step * (k + 1)
        deformation, internal = Following().evaluate(deformation, {**known, **internal})
    stress = Silicone().evaluate(deformation, {**known, **internal})[0]
    elastic = Silicone().evaluate(deformation, {**known, **internal, "viscosity": torch.zeros(1).double()})[0]
    assert float((stress - elastic)[0, 1]) == pytest.approx(viscosity * rate, rel=0.02)


def test_recordings_begin_to_move_where_the_first_jump_is() -> None:
    bare, loaded = read(GRAVITY_FILE), read(LOADED_FILE)
    assert (bare.first_moved, loaded.first_moved) == (72, 44)
    assert bare.onset == pytest.approx(0.706, abs=1e-3)


def _swinging(modulus: float, viscosity: float) -> Tip:
    """A tip that swings as one mass on a spring and a dashpot, in the plane of the beam."""
    time = np.arange(0.0, 2.2, 0.0025)
    omega, decay = 48.0 * np.sqrt(modulus / YOUNG), 2.5 * viscosity / 200.0
    share = (YOUNG / modulus) * (1.0 - np.exp(-decay * time) * np.cos(omega * time))
    gradient = np.tile(np.eye(3), (len(time), 1, 1))
    gradient[:, 0, 2], gradient[:, 2, 0] = -0.08 * share, 0.08 * share
    middle = np.stack((-6.6e-3 * share, 0.0 * time, LENGTH - 2e-4 * share), axis=1)
    return Tip(time, middle, gradient)


def _family() -> Family:
    low, middle, high = VISCOSITIES[0.0]
    known = [(YOUNG, low), (YOUNG, middle), (YOUNG, high), (SOFTER, middle * (SOFTER / YOUNG) ** 0.5)]
    return Family(0.0, [plain(_swinging(*one)) for one in known])


def _recorded(family: Family, noise: np.ndarray) -> tuple[Recording, np.ndarray]:
    bare = read(GRAVITY_FILE)
    truth = np.array((3.02e5, 230.0, 0.7043, -0.026, 0.058, 0.0, 1.0))
    tip = bare.rest + simulated(bare, family, truth, bare.time)
    moving = bare.time > truth[2]
    tip[moving] += noise[: moving.sum()]
    return Recording(bare.time, tip, bare.base), truth


def test_the_fit_finds_what_a_recording_was_made_with() -> None:
    family = _family()
    noise = 1e-6 * np.random.default_rng(0).standard_normal((500, 3, 3))
    recording, truth = _recorded(family, noise)
    free = (*LAW, "release", *REGISTRATION)
    found = fit(recording, family, start_of(recording, 0.0), free)
    which = [NAMES.index(name) for name in free]
    assert np.allclose(found.values[which], truth[which], rtol=2e-3, atol=2e-5)


def test_intervals_hold_the_truth_where_residuals_are_alike_in_time() -> None:
    family, free = _family(), (*LAW, "release", *REGISTRATION)
    held, narrow = [], []
    for seed in range(12):
        chance = np.random.default_rng(seed)
        drift = np.zeros(500)
        for k in range(1, 500):  # correlated over 0.2 s
            drift[k] = 0.95 * drift[k - 1] + 3e-5 * chance.standard_normal()
        noise = drift[:, None, None] * np.array((1.0, 0.0, 0.0))
        recording, truth = _recorded(family, noise)
        found = fit(recording, family, start_of(recording, 0.0), free)
        off = np.abs(found.values - truth)[:2]
        held.append(off <= found.half[:2])
        narrow.append(off <= found.naive[:2])
    assert np.mean(held) >= 0.8 > np.mean(narrow)


def test_the_page_is_that_of_the_results() -> None:
    document = json.loads((DOCS / "results" / "real_beam" / "real_beam.json").read_text(encoding="utf-8"))
    assert text_of(document["results"], "results/real_beam") == (DOCS / "real_beam.md").read_text(encoding="utf-8")
