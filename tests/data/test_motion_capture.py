"""Motion capture as people have it: any unit, frame and clock, gaps, and what is refused by name."""

import csv
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.real_beam.measured import GRAVITY_FILE
from pcnclaws.data.motion_capture import Capture
from pcnclaws.data.observation import Observation
from pcnclaws.data.observation_files import from_table
from pcnclaws.errors import UserError
from pcnclaws.geometry.shapes import PointCloud
from pcnclaws.mpm.settings import SimulationSettings

TURN, SHIFT = Rotation.from_euler("xyz", (40.0, -75.0, 110.0), degrees=True).as_matrix(), np.array((0.9, -0.4, 2.0))
MIRROR = np.diag((1.0, 1.0, -1.0))
FIXED = {"base1": [0.2, 0.1, 0.2], "base2": [0.8, 0.1, 0.25], "base3": [0.3, 0.1, 0.8]}
SETTINGS = SimulationSettings()


def wedge() -> PointCloud:
    """A body that fits on itself in one way: steps of different lengths along three axes."""
    axes = [0.3 + 0.02 * np.arange(n) for n in (20, 12, 8)]
    lattice = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    i, j, k = ((lattice - 0.3) / 0.02).round().T
    kept = lattice[(i < 8) | ((j < 4) & (k < 5)) | ((j < 8) & (i < 12) & (k < 2))]
    return PointCloud(kept, np.zeros_like(kept), np.full(len(kept), 0.02**3))


BODY = wedge()


def frames(count: int = 6) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Times, and places of markers that fall with the body, in the simulation's frame."""
    time = 0.01 * np.arange(count)
    low, high = BODY.position.min(0), BODY.position.max(0)
    on_surface = [p for p in BODY.position[::7] if (p == low).any() or (p == high).any()][::6]
    fall = np.zeros((count, 3))
    fall[:, 1] = -4.9 * time**2
    moving = {f"m{number}": place + fall for number, place in enumerate(on_surface)}
    return time, moving | {name: np.tile(place, (count, 1)) for name, place in FIXED.items()}


def written(
    path: Path, time: np.ndarray, places: dict[str, np.ndarray], factor: float = 1.0, mirror: bool = False
) -> Path:
    """A table with a line a frame, as a camera in another frame sees it."""
    turn = MIRROR @ TURN if mirror else TURN
    with path.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["Frame", "Time (Seconds)", *(f"{name}.{axis}" for name in places for axis in "XYZ")])
        for k, t in enumerate(time.tolist()):
            seen = [factor * (turn @ place[k] + SHIFT) for place in places.values()]
            cells = ["" if np.isnan(x) else repr(float(x)) for place in seen for x in place]
            rows.writerow([k, t, *cells])
    return path


def read(path: Path, capture: Capture) -> Observation:
    return from_table(path, "elasticity", SETTINGS, BODY, True, capture)


def fixed(units: str = "m") -> Capture:
    return Capture(units, {name: np.array(place) for name, place in FIXED.items()})


def test_three_fixed_markers_bring_millimetres_of_a_turned_camera_to_the_simulation(tmp_path: Path) -> None:
    time, places = frames()
    places["m3"][2] = np.nan
    seen = read(written(tmp_path / "a.csv", time, places, 1e3), fixed(units="mm"))
    expected = np.stack([place for name, place in places.items() if name not in FIXED], axis=1)
    np.testing.assert_allclose(seen.target, expected, atol=1e-12)
    assert not seen.seen[2, 3]
    assert seen.registration is not None
    assert seen.registration["rms"] < 1e-12


def test_the_residual_of_the_registration_is_told(tmp_path: Path, caplog) -> None:
    time, places = frames()
    places["base2"] = places["base2"] + np.array((2e-3, 0.0, 0.0))
    seen = read(written(tmp_path / "a.csv", time, places), fixed())
    assert seen.registration is not None
    assert 3e-4 < seen.registration["rms"] < 2e-3
    assert "registered by 3 markers to 0.000" in caplog.text


def test_markers_are_laid_on_the_rest_shape(tmp_path: Path) -> None:
    time, places = frames()
    moving = {name: place for name, place in places.items() if name not in FIXED}
    seen = read(written(tmp_path / "a.csv", time, moving, 1e2), Capture(units="cm", on_shape=True))
    np.testing.assert_allclose(seen.target, np.stack([*moving.values()], axis=1), atol=1e-6)
    assert seen.registration is not None
    assert seen.registration["other_placements"] == 0


def test_the_start_is_said_on_the_clock_of_the_file() -> None:
    """The measured beam: six markers, of which those of the clamp say the frame, released after 0.7 s."""
    axes = [(np.arange(n) + 0.5) * 0.005 for n in (6, 6, 20)]
    lattice = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3) + np.array((0.0385, 0.0152, -0.02))
    beam = PointCloud(lattice, np.zeros_like(lattice), np.full(len(lattice), 0.005**3))
    places = {
        "base1": np.array((0.0487, 0.0589, -0.0214)),
        "base2": np.array((0.0764, 0.0083, -0.0184)),
        "base3": np.array((0.0493, 0.0091, -0.0224)),
    }
    settings = SimulationSettings(grid_spacing=0.01, domain=None, gravity=(-9.81, 0.0, 0.0))
    seen = from_table(GRAVITY_FILE, "elasticity", settings, beam, True, Capture(places=places, start=0.7))
    assert (seen.time[0], seen.target.shape) == (0.0, (430, 3, 3))
    assert seen.time[1] == pytest.approx(0.01)
    sag = seen.target[-1] - seen.target[0]
    np.testing.assert_allclose(sag[:, 0], (-6.64e-3, -6.52e-3, -6.21e-3), atol=5e-5)
    assert seen.registration is not None
    assert seen.registration["rms"] < 2e-4


@pytest.mark.parametrize(
    ("factor", "mirror", "capture", "message"),
    [
        (1e3, False, fixed(), "markers of observation.frame are 1e\\+03 times .* observation.units=m .* in mm\\?"),
        (1.0, False, fixed(units="mm"), "observation.units=mm is in doubt; positions in m\\?"),
        (1e3, False, Capture(on_shape=True), "positions in mm\\?"),
        (1.3, False, fixed(), "no registration: marker 'base[123]' stays"),
        (1.0, True, fixed(), "on it in a mirror"),
        (1.0, True, Capture(on_shape=True), "no registration: .* a mirrored frame fits"),
        (
            1.0,
            False,
            Capture(places={"base1": np.zeros(3), "base2": np.ones(3)}),
            "names 2 markers; accepted: 3",
        ),
        (1.0, False, Capture(places={"base4": np.zeros(3)}), "base4.*did you mean 'base[123]'"),
        (1.0, False, Capture(places={f"base{k}": k * np.ones(3) for k in (1, 2, 3)}), "lie on a line"),
        (1.0, False, Capture(start=9.0), "observation.start=9 leaves no frame on one side"),
    ],
)
def test_units_and_frames_that_are_not_those_said_are_named(
    factor: float, mirror: bool, capture: Capture, message: str, tmp_path: Path
) -> None:
    time, places = frames()
    if capture.on_shape:
        places = {name: place for name, place in places.items() if name not in FIXED}
    with pytest.raises(UserError, match=message):
        read(written(tmp_path / "a.csv", time, places, factor, mirror), capture)


def test_three_markers_are_too_few_for_the_six_unknowns_of_a_frame(tmp_path: Path) -> None:
    time, places = frames()
    few = {name: places[name] for name in ("m0", "m5", "m9")}
    with pytest.raises(UserError, match="observation.frame=fit has 3 markers at the start; accepted: 4 or more"):
        read(written(tmp_path / "a.csv", time, few), Capture(on_shape=True))


def test_a_marker_in_another_unit_and_one_that_leaps_are_named(tmp_path: Path) -> None:
    time, places = frames()
    odd = {**places, "m4": 1e3 * places["m4"]}
    with pytest.raises(UserError, match="marker 'm4' is .* m from the origin .* mixed units\\?"):
        read(written(tmp_path / "a.csv", time, odd), fixed())
    places["m2"][3:] += 0.6
    with pytest.raises(UserError, match="marker 'm2' moves 1.04 m within 0.01 s at 0.03 s, the others"):
        read(written(tmp_path / "a.csv", time, places), fixed())


def test_times_that_run_backwards_are_refused(tmp_path: Path) -> None:
    time, places = frames()
    time[4] = 0.005
    with pytest.raises(UserError, match="line 6: the time 0.005 s comes after 0.03 s"):
        read(written(tmp_path / "a.csv", time, places), fixed())
    lines = ["time,marker,x,y,z", "0,a,.4,.4,.4", "0.02,a,.4,.4,.4", "0.01,a,.4,.4,.4"]
    (tmp_path / "b.csv").write_text("\n".join(lines))
    with pytest.raises(UserError, match="line 4: the time 0.01 s comes after 0.02 s"):
        read(tmp_path / "b.csv", Capture())


def test_a_column_that_is_missing_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("time_s,tip_x,tip_y\n0,1,2\n")
    with pytest.raises(UserError, match="marker 'tip' has no column of z"):
        read(tmp_path / "a.csv", Capture())
