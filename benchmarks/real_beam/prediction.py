"""What was predicted beside what was measured, and a prediction with a band for a load that nobody has shown us."""

import csv
import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.real_beam.fit import IN_PLANE, Fit, crept, simulated
from benchmarks.real_beam.measured import COLUMNS, Recording
from benchmarks.real_beam.runs import FIRST_GUESS, ringing
from benchmarks.real_beam.scene import DENSITY, GRAVITY, LENGTH, WIDTH
from benchmarks.real_beam.surrogate import SLOWEST, Family
from pcnclaws.atomic import replaced_file

# Bars of the prediction: sag and frequency, relative; RMS over the first seconds over the amplitude.
BARS = {"sag": 0.05, "frequency": 0.05, "rms": 0.15}
FIRST, SETTLED, SKIPPED = 2.0, 1.0, 0.05
HEAVY, LOADED = 0.101, 0.052
RATE, FRAMES, LET_GO = 100.0, 600, 0.5
DRAWS, BAND = 600, (5.0, 95.0)
# How far E goes on falling with the load: not at all to a fifth more than in proportion.
GOES_ON = (0.0, 1.2)
# Relative spread of the viscosity beyond its trend, and the spread of the release [s].
VISCOSITY_SPREAD, RELEASE_SPREAD = 0.2, 0.005
CLAMP_SPREAD = 1e-4


def figures(height: np.ndarray, time: np.ndarray, release: float, guess: float) -> dict[str, float]:
    """Sag in the last second [m] and frequency in the first two [Hz] of a displacement of the tip."""
    rung = (time > release + SKIPPED) & (time < release + FIRST)
    return {
        "sag": float(-height[time > time[-1] - SETTLED].mean()),
        "frequency": ringing(time[rung] - release, height[rung], guess)[1],
        "damping": ringing(time[rung] - release, height[rung], guess)[2],
    }


def comparison(recording: Recording, family: Family, values: np.ndarray, weight: float) -> dict[str, Any]:
    """Measured and simulated figures of the first marker of the tip, their differences, and which bars they meet."""
    time, onset = recording.time, recording.onset
    measured = (recording.tip - recording.rest)[:, 0, 0]
    ours = simulated(recording, family, values, time)[:, 0, 0]
    first = (time >= onset) & (time <= onset + FIRST)
    amplitude = 0.5 * float(np.ptp(measured[first]))
    theirs, found = (figures(one, time, onset, FIRST_GUESS[weight]) for one in (measured, ours))
    rms = float(np.sqrt(np.mean((measured - ours)[first] ** 2)))
    differences = {name: found[name] / theirs[name] - 1.0 for name in ("sag", "frequency")} | {"rms": rms / amplitude}
    return {
        "measured": theirs,
        "simulated": found,
        "amplitude": amplitude,
        "rms": rms,
        "differences": differences,
        "met": {name: abs(differences[name]) <= bar for name, bar in BARS.items()},
        "curve": {
            "time": time.tolist(),
            "measured": np.round(measured, 7).tolist(),
            "simulated": np.round(ours, 7).tolist(),
        },
    }


@dataclass(frozen=True)
class Known:
    """A recording, what was fitted to it, and its family of simulations."""

    recording: Recording
    fit: Fit
    family: Family
    weight: float

    @property
    def ringing(self) -> tuple[float, float, float]:
        """Rest [m], frequency [Hz], and share of the critical damping of the fitted motion."""
        return _ringing(self.family, self.fit.values, self.weight)


def moment(weight: float) -> float:
    """At the clamp [N m], of the beam's own weight and of one that hangs on its tip."""
    return GRAVITY * LENGTH * (0.5 * DENSITY * WIDTH**2 * LENGTH + weight)


def with_band(bare: Known, loaded: Known, family: Family, weight: float, seed: int) -> dict[str, np.ndarray]:
    """The motion with a weight [kg], and its band, by the trends of E and viscosity over two loads.

    E falls with the moment at the clamp by GOES_ON of what it fell by between the two; viscosity follows the power of
    the frequency that leads from one to the other. What the fit of the loaded recording leaves is the discrepancy:
    its size, a running RMS, is scaled by the sag and, in time, by the period.

    returns  "time" [s], "middle", "low", "high" (frames, 6, 3) [m]
    """
    generator = np.random.default_rng(seed)
    time = np.arange(FRAMES) / RATE - LET_GO
    recording, rest = loaded.recording, np.concatenate((loaded.recording.rest, loaded.recording.base_rest))
    offsets = np.abs(rest - np.concatenate((bare.recording.rest, bare.recording.base_rest)))
    trend = (loaded.fit.values[0] - bare.fit.values[0]) / (moment(LOADED) - moment(0.0))
    places = recording.places(*loaded.fit.values[3:5].tolist())
    creep = loaded.fit.values[5:].tolist()
    power = np.log(loaded.fit.values[1] / bare.fit.values[1]) / np.log(bare.ringing[1] / loaded.ringing[1])

    def motion(share: float, more: float, wider: float, late: float) -> np.ndarray:
        modulus = float(loaded.fit.values[0] * (1.0 + more)) + share * trend * (moment(weight) - moment(LOADED))
        viscosity = loaded.fit.values[1]
        for _ in range(2):  # viscosity depends on the frequency, and that hardly on the viscosity
            slower = _ringing(family, np.array((modulus, viscosity)), weight)[1]
            viscosity = loaded.fit.values[1] * (loaded.ringing[1] / slower) ** power
        viscosity = float(np.clip(viscosity * wider, 0.3 * family.viscosities[0], 1.3 * family.viscosities[-1]))
        return crept(family, places, time - late, (modulus, viscosity, *creep))

    centre = motion(float(np.mean(GOES_ON)), 0.0, 1.0, 0.0)
    spread = loaded.fit.half[0] / 1.96 / loaded.fit.values[0]
    left = _left(bare, loaded, centre, time)
    draws = np.empty((DRAWS, FRAMES, 6, 3))
    for draw in draws:
        moved = motion(
            generator.uniform(*GOES_ON),
            spread * generator.standard_normal(),
            float(np.exp(VISCOSITY_SPREAD * generator.standard_normal())),
            RELEASE_SPREAD * generator.standard_normal(),
        )
        draw[:, :3] = moved + left * generator.standard_normal((1, 3, 3))
        draw[:, 3:] = CLAMP_SPREAD * generator.standard_normal((1, 3, 3))
        draw += offsets * generator.standard_normal((6, 3))
    low, high = np.percentile(draws, BAND, axis=0)
    still = np.zeros((FRAMES, 3, 3))
    return {
        "time": time + LET_GO,
        "middle": rest + np.concatenate((centre, still), axis=1),
        "low": rest + low,
        "high": rest + high,
    }


def coverage(bare: Known, loaded: Known, seed: int) -> float:
    """The share of points of the loaded recording in a band made in the same way for its own load.

    It has seen this recording, so that it tells a band that is too narrow, and not one that is right.
    """
    band = with_band(bare, loaded, loaded.family, LOADED, seed)
    recording = loaded.recording
    where = band["time"] - LET_GO + recording.onset
    inside = where <= recording.time[-1]
    moved = recording.tip[:, :, IN_PLANE].reshape(len(recording.time), -1)
    measured = np.stack([np.interp(where[inside], recording.time, column) for column in moved.T], axis=1)
    low, high = (band[edge][inside][:, :3][:, :, IN_PLANE].reshape(len(measured), -1) for edge in ("low", "high"))
    return float(np.mean((measured >= low) & (measured <= high)))


def write_prediction(found: Mapping[str, np.ndarray], path: Path) -> list[Path]:
    """A file with the columns of the recordings, and one beside it with the band, <name>_band.csv."""
    band = path.with_name(f"{path.stem}_band{path.suffix}")
    edges = [f"{column}_{edge}" for column in COLUMNS[1:] for edge in ("low", "high")]
    both = np.stack((found["low"], found["high"]), axis=-1).reshape(FRAMES, -1)
    _write(path, COLUMNS, found["time"], found["middle"].reshape(FRAMES, -1))
    _write(band, [COLUMNS[0], *edges], found["time"], both)
    return [path, band]


def _write(path: Path, head: list[str], time: np.ndarray, values: np.ndarray) -> None:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    writer.writerows([f"{t:.2f}", *(f"{value:.7f}" for value in row)] for t, row in zip(time, values, strict=True))
    with replaced_file(path) as part:
        part.write(text.getvalue().encode())


def _ringing(family: Family, values: np.ndarray, weight: float) -> tuple[float, float, float]:
    time = np.arange(SKIPPED, FIRST, 0.01)
    height = family.displacement(time, np.array([(0.0, 0.0, LENGTH)]), float(values[0]), float(values[1]))[:, 0, 0]
    return ringing(time, height, FIRST_GUESS.get(weight, SLOWEST))


def _left(bare: Known, loaded: Known, centre: np.ndarray, time: np.ndarray) -> np.ndarray:
    """The size of the discrepancy at each time of the prediction [m], (frames, 3, 3)."""
    recording, values = loaded.recording, loaded.fit.values
    own = simulated(recording, loaded.family, values, recording.time)
    residual = recording.tip - recording.rest - own
    width = round(0.3 * RATE)
    window = np.ones(width) / width
    padded = np.pad(residual**2, ((width // 2, width - 1 - width // 2), (0, 0), (0, 0)), mode="edge")
    sums = np.apply_along_axis(lambda column: np.convolve(column, window, "valid"), 0, padded)
    running = np.sqrt(np.asarray(sums, dtype=np.float64))
    slower = loaded.ringing[1] / _period_of(centre, time)
    larger = centre[-1, 0, 0] / own[-1, 0, 0]
    where = recording.time - values[2]
    found = [np.interp(time / slower, where, column) for column in running.reshape(len(where), -1).T]
    # nothing is left before the release, but for the noise of the markers
    after = (time >= 0.0)[:, None, None]
    return np.where(after, larger * np.stack(found, axis=1).reshape(-1, 3, 3), CLAMP_SPREAD)


def _period_of(moved: np.ndarray, time: np.ndarray) -> float:
    """The frequency of the first marker [Hz]."""
    rung = (time > SKIPPED) & (time < FIRST)
    return ringing(time[rung], moved[rung, 0, 0], SLOWEST)[1]
