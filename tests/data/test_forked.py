"""Work in a child: its result, its words and its errors come back; what ends it does not end us."""

import json
import logging
import os
import pickle
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

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


def test_an_error_of_the_reader_itself_keeps_its_words_and_its_place() -> None:
    def wrong() -> None:
        raise KeyError("colour")

    with pytest.raises(RuntimeError, match="^KeyError: 'colour'") as raised:
        in_child(wrong, 30.0)
    assert "in wrong" in raised.value.__notes__[0]


class Payload:
    """Leaves a mark where it is unpickled."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> Any:
        return Path.touch, (self.mark,)


def _saying(head: bytes, *arrays: bytes, sizes: tuple[int, ...] = ()) -> bytes:
    """What a child that a file has taken over may send: parts with their sizes, right or not."""
    parts = (head, *arrays)
    numbers = (len(parts), *(sizes or map(len, parts)))
    return b"".join(number.to_bytes(8, "little") for number in numbers) + b"".join(parts)


def _result(value: object, log: object = ()) -> bytes:
    return json.dumps({"map": [["result", value], ["error", None], ["log", log]]}).encode()


HOSTILE: dict[str, Callable[[Path], bytes]] = {
    "a pickle": lambda mark: _saying(pickle.dumps((Payload(mark), None, []))),
    "a pickle as an array of objects": lambda mark: _saying(
        _result({"array": ["|O", [1]]}), pickle.dumps(Payload(mark))
    ),
    "an array beyond its part": lambda mark: _saying(_result({"array": ["<f8", [10**12]]}), bytes(8)),
    "an array of negative length": lambda mark: _saying(_result({"array": ["<f8", [-1, -1]]}), bytes(8)),
    "an array of no part": lambda mark: _saying(_result({"array": ["<f8", [1]]})),
    "a part of no array": lambda mark: _saying(_result(1), bytes(8)),
    "brackets": lambda mark: _saying(b"[" * 10**5),
    "an object": lambda mark: _saying(_result({"Path": ["x"]})),
    "no log": lambda mark: _saying(_result(1, [3])),
    "sizes beyond any memory": lambda mark: _saying(b"{}", sizes=(2**62,)),
    "more parts than there are": lambda mark: (2**60).to_bytes(8, "little"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_what_a_child_sends_that_a_file_has_taken_over_runs_nothing(name: str, tmp_path: Path) -> None:
    mark = tmp_path / "mark"
    before = set(Path("/proc/self/fd").iterdir())
    content = HOSTILE[name](mark)

    def taken_over() -> None:
        (pipe,) = (path for path in set(Path("/proc/self/fd").iterdir()) - before if path.is_fifo())
        os.write(int(pipe.name), content)
        os._exit(0)

    with pytest.raises(ChildFailed, match="no result|memory"):
        in_child(taken_over, 5.0)
    assert not mark.exists()


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
