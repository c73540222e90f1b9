"""The measured beam: its law, its fit on made-up recordings, and the page that is made of the results."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch

from benchmarks.pages.real_beam import text_of
from benchmarks.real_beam.conclusions import LAW, PLACE, VISCOUS_LAW
from benchmarks.real_beam.fit import NAMES, fit, simulated, start_of
from benchmarks.real_beam.law import RELAXATION_TIMES, VISCOUS, Following, Silicone, complex_modulus, strengths
from benchmarks.real_beam.measured import GRAVITY_FILE, LOADED_FILE, Recording, read
from benchmarks.real_beam.prediction import from_first_turn
from benchmarks.real_beam.runs import plain, ringing
from benchmarks.real_beam.scene import LENGTH, Tip
from benchmarks.real_beam.surrogate import STIFFENED_AT, Family, Law, Oscillator
from pcnclaws.laws.formulas import TIME_STEP

DOCS = Path(__file__).parents[2] / "docs"
YOUNG, SHEAR = 3e5, 3e5 / 2.9
SIMULATED = (2.5e5, 0.29, 0.27)


def _known(moduli: np.ndarray, step: float) -> dict[str, torch.Tensor]:
    named = {f"strength_{k + 1}": float(value) for k, value in enumerate(moduli)}
    given = {"youngs_modulus": YOUNG, "poissons_ratio": 0.45, **named, TIME_STEP: step}
    return {name: torch.tensor([value], dtype=torch.float64) for name, value in given.items()}


def _sheared(shear: np.ndarray, step: float, moduli: np.ndarray) -> np.ndarray:
    """The shear stress over time [Pa], of simple shears (steps,)."""
    known = _known(moduli, step)
    internal = {one.name: torch.zeros(1, dtype=torch.float64) for one in Following.internal_variables}
    deformation = torch.eye(3, dtype=torch.float64)[:, :, None].clone()
    stress = []
    for value in shear.tolist():
        deformation[0, 1] = value
        deformation, internal = Following().evaluate(deformation, {**known, **internal})
        stress.append(float(Silicone().evaluate(deformation, {**known, **internal})[0][0, 1]))
    return np.array(stress)


def test_in_steady_shear_a_steep_power_is_a_newtonian_viscosity() -> None:
    rate, viscosity, step = 0.5, 200.0, 1e-4
    moduli = strengths(viscosity / (SHEAR * RELAXATION_TIMES[0]), VISCOUS)
    shear = rate * step * np.arange(1, 301)
    stress = _sheared(shear, step, moduli) - _sheared(shear, step, 0.0 * moduli)
    assert stress[-1] == pytest.approx(viscosity * rate, rel=0.02)


def test_after_a_step_of_shear_the_stress_falls_as_the_maxwell_elements_do() -> None:
    step, moduli = 1e-4, strengths(0.3, 0.25)
    stress = _sheared(np.full(400, 1e-3), step, moduli) / (SHEAR * 1e-3)
    time = step * np.arange(1, 401)
    expected = 1.0 + np.exp(-time[:, None] / np.asarray(RELAXATION_TIMES)) @ moduli
    assert np.allclose(stress, expected, rtol=2e-3)


def test_the_loss_factor_is_even_where_the_exponent_is_zero() -> None:
    def loss(moduli: np.ndarray, frequency: float) -> float:
        modulus = complex_modulus(moduli, frequency)
        return modulus.imag / modulus.real

    even, viscous = strengths(0.15, 0.0), strengths(1.3, VISCOUS)
    assert loss(even, 7.73) == pytest.approx(loss(even, 4.35), rel=0.02)
    assert loss(viscous, 7.73) == pytest.approx(loss(viscous, 4.35) * 7.73 / 4.35, rel=0.02)


def test_an_oscillator_rings_with_the_complex_modulus() -> None:
    moduli, time = strengths(0.05, 0.3), np.arange(0.0, 2.0, 0.002)
    height = Oscillator(7.0, 7e-3, 0.0).height(time, moduli)
    _, frequency, damping = ringing(time, height, 7.2)
    modulus = complex_modulus(moduli, frequency)
    assert frequency == pytest.approx(7.0 * modulus.real**0.5, rel=2e-3)
    assert damping == pytest.approx(0.5 * modulus.imag / modulus.real, rel=0.05)
    assert -Oscillator(7.0, 7e-3, 0.0).height(np.array([1e3]), moduli)[0] == pytest.approx(7e-3)


def test_a_cubic_spring_rests_where_its_force_is_that_of_the_weight() -> None:
    moduli, sag, share = strengths(0.1, 0.3), 7e-3, 0.3
    late = np.array([5.9])
    height = Oscillator(7.0, sag, 60.0).stiffened(late, 0.0 * moduli, share)[0]
    assert -(height + share * height**3 / STIFFENED_AT**2) == pytest.approx(sag, rel=1e-3)
    linear, time = Oscillator(7.0, sag, 0.3), np.arange(0.0, 1.0, 0.01)
    assert np.allclose(linear.stiffened(time, moduli, 0.0), linear.height(time, moduli), atol=0.03 * sag)


def test_recordings_begin_to_move_where_the_first_jump_is() -> None:
    bare, loaded = read(GRAVITY_FILE), read(LOADED_FILE)
    assert (bare.first_moved, loaded.first_moved) == (72, 44)
    assert bare.onset == pytest.approx(0.706, abs=1e-3)


def _swinging(modulus: float, strength: float, exponent: float) -> Tip:
    """A tip that swings as one mass on a spring and Maxwell elements, in the plane of the beam."""
    time = np.arange(0.0, 2.4, 0.0025)
    oscillator = Oscillator(7.0, 7.6e-3, 0.3).with_modulus(modulus / SIMULATED[0])
    height = oscillator.height(time, strengths(strength, exponent))
    gradient = np.tile(np.eye(3), (len(time), 1, 1))
    gradient[:, 0, 2], gradient[:, 2, 0] = 12.4 * height, -12.4 * height
    middle = np.stack((height, 0.0 * time, LENGTH - 4.0 * height**2), axis=1)
    return Tip(time, middle, gradient)


def _family(law: tuple[float, float, float] = SIMULATED) -> Family:
    known = {"youngs_modulus": law[0], "strengths": strengths(*law[1:]).tolist(), "weight": 0.0}
    return Family(plain(_swinging(*law)) | known)


def test_a_family_is_its_simulation_and_follows_the_law() -> None:
    family, other, time = _family(), (2.7e5, 0.25, 0.35), np.arange(0.0, 2.3, 0.01)
    place = np.array([(0.01, 0.0, 0.098)])
    for law, tolerance in ((SIMULATED, 2e-8), (other, 3e-6)):
        expected = _family(law).tip.displacement(place)[:: round(0.01 / 0.0025)][: len(time)]
        found = family.displacement(time, place, Law(law[0], strengths(*law[1:])))
        assert np.abs(found - expected).max() < tolerance


def _recorded(family: Family, noise: np.ndarray) -> tuple[Recording, np.ndarray]:
    bare = read(GRAVITY_FILE)
    truth = np.array((2.6e5, 0.27, 0.3, 0.7043, -0.026, 0.058, 8e-4, 0.0, 0.0))
    tip = bare.rest + simulated(bare, family, truth, bare.time)
    moving = bare.time > truth[3]
    tip[moving] += noise[: moving.sum()]
    return Recording(bare.time, tip, bare.base), truth


def test_the_fit_finds_what_a_recording_was_made_with() -> None:
    family = _family()
    noise = 1e-6 * np.random.default_rng(0).standard_normal((500, 3, 3))
    recording, truth = _recorded(family, noise)
    free = (*LAW, *PLACE, "held")
    found = fit(recording, family, start_of(recording, SIMULATED), free)
    which = [NAMES.index(name) for name in free]
    assert np.allclose(found.values[which], truth[which], rtol=5e-3, atol=2e-5)


def test_a_start_that_is_read_off_turns_where_the_recording_does() -> None:
    family = _family()
    recording, truth = _recorded(family, np.zeros((500, 3, 3)))
    late = truth.copy()
    late[[3, 7]] = 0.715, 0.2
    tip = recording.rest + simulated(recording, family, late, recording.time)
    found = from_first_turn(Recording(recording.time, tip, recording.base), family, truth)
    assert found[3] == pytest.approx(late[3], abs=1e-3)
    assert found[7] == pytest.approx(late[7], abs=0.01)


def test_intervals_hold_the_truth_where_residuals_are_alike_in_time() -> None:
    family, free = _family(), (*VISCOUS_LAW, *PLACE)
    held, narrow = [], []
    for seed in range(12):
        chance = np.random.default_rng(seed)
        drift = np.zeros(500)
        for k in range(1, 500):  # correlated over 0.2 s
            drift[k] = 0.95 * drift[k - 1] + 3e-5 * chance.standard_normal()
        noise = drift[:, None, None] * np.array((1.0, 0.0, 0.0))
        recording, truth = _recorded(family, noise)
        start = truth + np.array((5e3, 0.02, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
        found = fit(recording, family, start, free)
        off = np.abs(found.values - truth)[:2]
        held.append(off <= found.half[:2])
        narrow.append(off <= found.naive[:2])
    assert np.mean(held) >= 0.8 > np.mean(narrow)


def test_the_page_is_that_of_the_results() -> None:
    document = json.loads((DOCS / "results" / "real_beam" / "real_beam.json").read_text(encoding="utf-8"))
    assert text_of(document["results"], "results/real_beam") == (DOCS / "real_beam.md").read_text(encoding="utf-8")
