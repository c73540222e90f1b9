"""What was predicted beside what was measured, and a start that is read off a recording."""

from typing import Any

import numpy as np

from benchmarks.real_beam.fit import moved, simulated
from benchmarks.real_beam.measured import FALL, Recording, lowest
from benchmarks.real_beam.runs import FIRST_GUESS, ringing
from benchmarks.real_beam.surrogate import LATE, Family

# Bars of the prediction: sag and frequency, relative; RMS over the first seconds over the amplitude.
BARS = {"sag": 0.05, "frequency": 0.05, "rms": 0.15}
FIRST, SETTLED, SKIPPED = 2.0, 1.0, 0.05
LOADED = 0.052


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


def from_first_turn(recording: Recording, family: Family, values: np.ndarray) -> np.ndarray:
    """Values whose motion first turns when and where the first marker of the recording does: a start that is read off.

    The release and the share of the sag from which the free motion begins follow in closed form.
    """
    places = recording.places(float(values[4]), float(values[5]))[:1]
    still = values.copy()
    still[[3, 7]] = 0.0
    time = np.arange(0.0, FALL, 1e-4)
    free = moved(family, places, still, time, 0.0)[:, 0, 0]
    frame = int(np.argmin(free))
    turns, depth = lowest(time[frame - 1 : frame + 2], free[frame - 1 : frame + 2])
    rest = float(moved(family, places, still, np.array([LATE]), 0.0)[0, 0, 0])
    measured, height = recording.first_turn
    found = values.copy()
    found[3], found[7] = measured - turns, (height - depth) / (rest - depth)
    return found
