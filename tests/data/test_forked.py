"""Work in a child: its result, its words and its errors come back; what ends it does not end us."""

import logging
import os
import signal
import time
from pathlib import Path

import numpy as np
import pytest

import benchmarks
from pcnclaws.data.forked import ChildFailed, in_child
from pcnclaws.data.hdf5 import read_scenes
from pcnclaws.errors import UserError

CRASHING = Path(benchmarks.__path__[0]) / "fuzzing" / "corpus" / "trajectory" / "crashes_hdf5.h5"


def test_result_words_and_errors_come_back(caplog: pytest.LogCaptureFixture) -> None:
    def work() -> dict[str, np.ndarray]:
        logging.getLogger("pcnclaws.x").warning("%s of %d", "one", 2)
        return {"large": np.arange(1e6), "empty": np.zeros((0, 3)), "own": np.array([os.getpid()])}

    found = in_child(work, 30.0)
    np.testing.assert_array_equal(found["large"], np.arange(1e6))
    assert found["empty"].shape == (0, 3)
    assert found["own"][0] != os.getpid()
    found["large"][0] = 3.0
    assert caplog.messages == ["one of 2"]

    def wrong() -> None:
        raise UserError("a line")

    with pytest.raises(UserError, match="^a line$"):
        in_child(wrong, 30.0)


def test_what_ends_the_child_is_named() -> None:
    with pytest.raises(ChildFailed, match="^SIGSEGV$"):
        in_child(lambda: os.kill(os.getpid(), signal.SIGSEGV), 30.0)
    began = time.monotonic()
    with pytest.raises(ChildFailed, match=r"no end within 0\.2 s"):
        in_child(lambda: time.sleep(60.0), 0.2)
    assert time.monotonic() - began < 20.0
    with pytest.raises(ChildProcessError):
        os.wait()  # no child is left


def test_a_file_that_crashes_the_library_is_one_line() -> None:
    try:
        read_scenes(CRASHING)
        said = f"{CRASHING}: "  # another version of the library may find nothing wrong
    except UserError as error:
        said = str(error)
    assert said.startswith(f"{CRASHING}: ")
    assert "\n" not in said
