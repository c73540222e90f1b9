"""C3D files written byte by byte: both forms of storage to the last bit, names, times, units, and what is refused."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import benchmarks
from benchmarks.fuzzing.c3d_bytes import c3d_bytes
from pcnclaws.data.c3d_files import read_c3d
from pcnclaws.data.motion_capture import Capture
from pcnclaws.data.observation_files import from_table
from pcnclaws.errors import UserError
from pcnclaws.geometry.shapes import particles
from pcnclaws.mpm.settings import SimulationSettings

CRASHING = Path(benchmarks.__path__[0]) / "fuzzing" / "corpus" / "capture_c3d" / "crashes_ezc3d.c3d"
MILLIMETRES: dict[str, Any] = {"UNITS": "mm"}


@pytest.fixture(scope="module", autouse=True)
def _needs_the_reader(request: pytest.FixtureRequest) -> None:
    pytest.importorskip("ezc3d", reason="needs pip install 'pcnclaws[c3d]'")


def whole_numbers(frames: int = 5, points: int = 4) -> np.ndarray:
    return np.random.default_rng(0).integers(-32768, 32768, (frames, points, 3))


def written(path: Path, points: np.ndarray, **options: Any) -> Path:
    given = {
        "seen": np.ones(points.shape[:2], bool),
        "labels": [f"m{k}" for k in range(points.shape[1])],
        "rate": 100.0,
    }
    path.write_bytes(c3d_bytes(points, **({"scale": 0.1, "more": MILLIMETRES} | given | options)))
    return path


def test_integers_times_their_scale_are_not_rounded(tmp_path: Path) -> None:
    """A scale of 24 bits times an integer of 16 has 40 bits: single precision would round it."""
    stored = whole_numbers()
    found = read_c3d(written(tmp_path / "a.c3d", stored, scale=0.1))
    expected = float(np.float32(0.1)) * stored
    np.testing.assert_array_equal(found.position, expected)
    assert (found.position.astype(np.float32) != expected).any()


def test_single_precision_is_taken_as_it_is(tmp_path: Path) -> None:
    """The size of a negative scale is not a factor."""
    stored = np.random.default_rng(0).normal(size=(5, 4, 3)).astype(np.float32)
    found = read_c3d(written(tmp_path / "a.c3d", stored, scale=-0.1))
    np.testing.assert_array_equal(found.position, stored.astype(np.float64))


@pytest.mark.parametrize("scale", [0.1, -0.1])
def test_what_was_not_seen_is_left_out_whatever_stands_there(scale: float, tmp_path: Path) -> None:
    """Beside the sign, the last word of a point holds cameras (7 bits) and the size of a residual (8 bits)."""
    stored, seen = whole_numbers().astype(np.int16 if scale > 0 else np.float32), np.ones((5, 4), bool)
    seen[1, 2] = seen[4, 0] = False
    expected = seen.copy()
    if scale < 0:
        stored[3, 1, 0], expected[3, 1] = np.nan, False
    found = read_c3d(written(tmp_path / "a.c3d", stored, scale=scale, seen=seen))
    np.testing.assert_array_equal(np.isfinite(found.position), np.repeat(expected[:, :, None], 3, 2))


def test_times_are_those_of_the_frame_numbers(tmp_path: Path) -> None:
    """The first frame of a recording, number 1, is at 0 s; a part that was cut out keeps its place on that clock."""
    rate = 119.88
    whole = read_c3d(written(tmp_path / "a.c3d", whole_numbers(), rate=rate))
    part = read_c3d(written(tmp_path / "b.c3d", whole_numbers(), rate=rate, first_frame=11))
    np.testing.assert_array_equal(whole.time, np.arange(5) / float(np.float32(rate)))
    np.testing.assert_array_equal(part.time, np.arange(10, 15) / float(np.float32(rate)))


def test_points_go_by_their_labels(tmp_path: Path, caplog) -> None:
    """More than 255 of them go on in LABELS2; one without a label has its number, and a double one is told apart."""
    labels = [f"m{k}" for k in range(300)]
    assert read_c3d(written(tmp_path / "a.c3d", whole_numbers(2, 300), labels=labels)).names == labels
    found = read_c3d(written(tmp_path / "b.c3d", whole_numbers(2, 5), labels=["tip", "", "M\xfcller", "tip"]))
    assert found.names == ["tip", "point 2", "M\xfcller", "tip (2)", "point 5"]
    assert "the label 'tip' is there twice; point 4 is 'tip (2)'" in caplog.text


def test_angles_and_forces_among_the_points_are_no_markers(tmp_path: Path, caplog) -> None:
    more = MILLIMETRES | {"ANGLES": ["knee"], "FORCES": ["grip"]}
    found = read_c3d(written(tmp_path / "a.c3d", whole_numbers(2, 4), labels=["a", "knee", "b", "grip"], more=more))
    assert found.names == ["a", "b"]
    np.testing.assert_array_equal(found.position, float(np.float32(0.1)) * whole_numbers(2, 4)[:, [0, 2]])
    assert "not read: knee, grip" in caplog.text


@pytest.mark.parametrize(
    ("word", "unit"), [("mm", "mm"), ("Meters", "m"), ("CM", "cm"), ("inches", "in"), ("yd", None)]
)
def test_the_unit_is_that_of_the_file(word: str, unit: str | None, tmp_path: Path) -> None:
    assert read_c3d(written(tmp_path / "a.c3d", whole_numbers(), more={"UNITS": word})).units == unit


# A cube that falls, followed by its corners.
BODY = particles("cube", (0.5, 0.5, 0.5), 0.2, 3, "centres")


def falling(path: Path, factor: float, **options: Any) -> tuple[Path, np.ndarray]:
    """A file of it, and places of its markers in the simulation's frame [m]."""
    time = 0.01 * np.arange(6)
    places = np.repeat(BODY.position[None, [0, 2, 6, 18]], len(time), axis=0)
    places[:, :, 1] -= 4.9 * time[:, None] ** 2
    stored = (factor * places).astype(np.float32)
    return written(path, stored, scale=-1.0, **options), stored.astype(np.float64) / factor


def observed(path: Path, capture: Capture | None = None) -> np.ndarray:
    return from_table(path, "elasticity", SimulationSettings(), BODY, velocity_known=True, capture=capture).target


def test_an_observation_is_brought_to_metres(tmp_path: Path, caplog) -> None:
    path, expected = falling(tmp_path / "a.c3d", 1e3)
    np.testing.assert_allclose(observed(path), expected, rtol=1e-15)
    np.testing.assert_allclose(observed(path, Capture(start=0.0))[1:], expected[1:], rtol=1e-15)
    assert "says that" not in caplog.text


def test_observation_units_hold_against_the_file_and_the_contradiction_is_told(tmp_path: Path, caplog) -> None:
    path, expected = falling(tmp_path / "a.c3d", 1e2)
    np.testing.assert_allclose(observed(path, Capture(units="cm")), expected, rtol=1e-15)
    assert "says that its lengths are in mm; observation.units=cm holds" in caplog.text


def test_a_file_without_a_unit_needs_one(tmp_path: Path) -> None:
    path, expected = falling(tmp_path / "a.c3d", 1e3, more={})
    np.testing.assert_allclose(observed(path, Capture(units="mm")), expected, rtol=1e-15)
    with pytest.raises(UserError, match=r"does not say its unit of length; accepted: observation.units= one of m, cm"):
        observed(path)


def test_damaged_files_are_refused_in_one_line(tmp_path: Path, capfd) -> None:
    whole = written(tmp_path / "a.c3d", whole_numbers(50)).read_bytes()
    damaged = {"empty": b"", "text": b"time,marker,x,y,z\n", "head": whole[:512], "parameters": whole[:900]}
    for name, content in damaged.items():
        path = tmp_path / f"{name}.c3d"
        path.write_bytes(content)
        with pytest.raises(UserError) as refused:
            read_c3d(path)
        assert str(refused.value).startswith(str(path))
        assert "\n" not in str(refused.value)
    assert capfd.readouterr() == ("", "")


def test_a_file_on_which_the_library_crashes_is_refused_in_one_line(capfd) -> None:
    with pytest.raises(UserError, match=r"damaged or unreadable \("):
        read_c3d(CRASHING)
    assert capfd.readouterr() == ("", "")


def test_a_file_that_is_cut_short_is_told(tmp_path: Path, caplog) -> None:
    """A frame of four points takes 32 bytes, and data begin after two blocks: 18 are left."""
    stored = whole_numbers(50)
    path = written(tmp_path / "a.c3d", stored)
    path.write_bytes(path.read_bytes()[:1600])
    np.testing.assert_array_equal(read_c3d(path).position, float(np.float32(0.1)) * stored[:18])
    assert "its header says 50 frames, and 18 are there; is it cut short?" in caplog.text


def test_a_file_without_points_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="holds no points; accepted"):
        read_c3d(written(tmp_path / "a.c3d", whole_numbers(5, 0)))


def test_a_header_that_claims_more_than_there_is_takes_no_memory(tmp_path: Path) -> None:
    claimed = {"USED": np.array(-1, "<i2"), "FRAMES": np.array(-1, "<i2")}
    path = written(tmp_path / "a.c3d", whole_numbers(), more=MILLIMETRES | claimed)
    content = bytearray(path.read_bytes())
    content[2:4] = content[8:10] = b"\xff\xff"  # points, and the last frame
    path.write_bytes(content)
    with pytest.raises(UserError, match="damaged or unreadable"):
        read_c3d(path)


def test_without_a_rate_there_are_no_times(tmp_path: Path) -> None:
    path = written(tmp_path / "a.c3d", whole_numbers(), rate=0.0)
    with pytest.raises(UserError, match="at a rate of 0 a second; accepted"):
        read_c3d(path)


def test_a_line_says_how_to_install_the_reader(tmp_path: Path, monkeypatch) -> None:
    path = written(tmp_path / "a.c3d", whole_numbers())
    monkeypatch.setitem(sys.modules, "ezc3d", None)
    with pytest.raises(UserError, match=r"a C3D file needs ezc3d, .*pip install 'pcnclaws\[c3d\]'"):
        read_c3d(path)
