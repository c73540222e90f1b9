"""A prediction with a band for a load that nobody has shown us, by the trend over two loads."""

import csv
import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.real_beam.fit import IN_PLANE, Fit, moved, simulated
from benchmarks.real_beam.measured import COLUMNS, Recording
from benchmarks.real_beam.prediction import FIRST, LOADED, SKIPPED
from benchmarks.real_beam.runs import FIRST_GUESS, ringing
from benchmarks.real_beam.scene import DENSITY, GRAVITY, LENGTH, WIDTH
from benchmarks.real_beam.surrogate import Family
from pcnclaws.atomic import replaced_file

HEAVY = 0.101
RATE, FRAMES, LET_GO = 100.0, 600, 0.5
DRAWS, BAND = 600, (5.0, 95.0)
# How far E goes on falling with the load: not at all to a fifth more than in proportion.
GOES_ON = (0.0, 1.2)
# How much later, and further down, the free motion begins, relative to the last recording.
STARTS = (0.0, 2.0)
# Relative spread of the damping, and the spread of the release [s].
STRENGTH_SPREAD, RELEASE_SPREAD = 0.2, 0.005
CLAMP_SPREAD = 1e-4


@dataclass(frozen=True)
class Known:
    """A recording, what was fitted to it, and its family of simulations."""

    recording: Recording
    fit: Fit
    family: Family


def moment(weight: float) -> float:
    """At the clamp [N m], of the beam's own weight and of one that hangs on its tip."""
    return GRAVITY * LENGTH * (0.5 * DENSITY * WIDTH**2 * LENGTH + weight)


def trend(bare: Known, loaded: Known, weight: float, share: float) -> float:
    """Long-term E with a weight [Pa], which goes on falling with the moment by a share of what it did."""
    slope = (loaded.fit.values[0] - bare.fit.values[0]) / (moment(LOADED) - moment(0.0))
    return float(loaded.fit.values[0] + share * slope * (moment(weight) - moment(LOADED)))


def with_band(bare: Known, loaded: Known, family: Family, weight: float, seed: int) -> dict[str, np.ndarray]:
    """The motion with a weight [kg], and its band, by the trend of E over two loads and a start like that of the last.

    E falls with the moment at the clamp by GOES_ON of what it fell by between the two. The free motion begins as much
    later than the first movement, and as far down, as it did with the last weight, times STARTS. What the fit of that
    recording leaves is the discrepancy: its size, a running RMS, is scaled by the sag and, in time, by the period.

    returns  "time" [s], "middle", "low", "high" (frames, 6, 3) [m]
    """
    generator = np.random.default_rng(seed)
    time = np.arange(FRAMES) / RATE - LET_GO
    recording, rest = loaded.recording, np.concatenate((loaded.recording.rest, loaded.recording.base_rest))
    offsets = np.abs(rest - np.concatenate((bare.recording.rest, bare.recording.base_rest)))
    places = recording.places(*loaded.fit.values[4:6].tolist())
    late = loaded.fit.values[3] - recording.onset

    def motion(share: float, more: float, stronger: float, start: float, shift: float) -> np.ndarray:
        values = loaded.fit.values.copy()
        values[0] = trend(bare, loaded, weight, share) * (1.0 + more)
        values[1] *= stronger
        values[3], values[7] = start * late + shift, start * values[7]
        return moved(family, places, values, time, 0.0)

    centre = motion(float(np.mean(GOES_ON)), 0.0, 1.0, float(np.mean(STARTS)), 0.0)
    spread = loaded.fit.half[0] / 1.96 / loaded.fit.values[0]
    left = _left(loaded, centre, time)
    draws = np.empty((DRAWS, FRAMES, 6, 3))
    for draw in draws:
        one = motion(
            generator.uniform(*GOES_ON),
            spread * generator.standard_normal(),
            float(np.exp(STRENGTH_SPREAD * generator.standard_normal())),
            generator.uniform(*STARTS),
            RELEASE_SPREAD * generator.standard_normal(),
        )
        draw[:, :3] = one + left * generator.standard_normal((1, 3, 3))
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
    markers = recording.tip[:, :, IN_PLANE].reshape(len(recording.time), -1)
    measured = np.stack([np.interp(where[inside], recording.time, column) for column in markers.T], axis=1)
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


def _left(loaded: Known, centre: np.ndarray, time: np.ndarray) -> np.ndarray:
    """The size of the discrepancy at each time of the prediction [m], (frames, 3, 3)."""
    recording, values = loaded.recording, loaded.fit.values
    own = simulated(recording, loaded.family, values, recording.time)
    residual = recording.tip - recording.rest - own
    width = round(0.3 * RATE)
    window = np.ones(width) / width
    padded = np.pad(residual**2, ((width // 2, width - 1 - width // 2), (0, 0), (0, 0)), mode="edge")
    sums = np.apply_along_axis(lambda column: np.convolve(column, window, "valid"), 0, padded)
    running = np.sqrt(np.asarray(sums, dtype=np.float64))
    where = recording.time - recording.onset
    slower = _frequency_of(own, where) / _frequency_of(centre, time)
    larger = centre[-1, 0, 0] / own[-1, 0, 0]
    found = [np.interp(time / slower, where, column) for column in running.reshape(len(where), -1).T]
    # nothing is left before the release, but for the noise of the markers
    after = (time >= 0.0)[:, None, None]
    return np.where(after, larger * np.stack(found, axis=1).reshape(-1, 3, 3), CLAMP_SPREAD)


def _frequency_of(displaced: np.ndarray, time: np.ndarray) -> float:
    """Of the first marker [Hz]; time after the release [s]."""
    rung = (time > SKIPPED) & (time < FIRST)
    return ringing(time[rung], displaced[rung, 0, 0], FIRST_GUESS[LOADED])[1]
