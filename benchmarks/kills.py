"""Interruptions: commands that are killed, signalled, run out of disk, are copied or met by another; then run again.

What they leave must be whole at any moment, and the same command must end where an uninterrupted one does, to the
last bit. Resumable.
"""

import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from rich.table import Table

from benchmarks.checks import names
from benchmarks.context import BenchmarkContext, Checkpointed
from benchmarks.left_files import broken_files, other_results, results_of
from pcnclaws.commands.configuration import whole_number
from pcnclaws.errors import UserError
from pcnclaws.geometry.body import Body
from pcnclaws.interface.scene import Scene
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.constitutive_model import ConstitutiveModel
from pcnclaws.laws.materials import material_named

SECONDS = 300.0
STATUS = {signal.SIGINT: 1, signal.SIGTERM: 143}
SMALL_DISK = "40k"
SEEDS = ("1", "2")  # of the jobs of a sweep
PLAIN = ("threads=1", "device=cpu")
BODY = ("material=elasticity", "scene.side=0.25", "scene.particles_per_edge=5", "simulation.steps=200")
TRAINING = ("material=elasticity", "model.width=8", "picture=false", "training.check_every=1")
SHORT = ("training.segment_length.first=10", "training.segment_length.last=10", "training.batch_segments=2")


class Ended(NamedTuple):
    """How a command ended: its exit status, the lines that begin with error, whether there was a traceback."""

    status: int
    errors: list[str]
    traceback: bool

    @property
    def in_words(self) -> str:
        """Status and message."""
        return f"status {self.status}{': a traceback' if self.traceback else ''} {' '.join(self.errors)[:200]}".strip()


class Trial(NamedTuple):
    """A command, and what an uninterrupted one leaves.

    line     the command line, the entry first
    results  contents by path, see results_of
    seconds  that it takes
    jobs     that it does, each of which says one line where it fails
    """

    name: str
    line: Sequence[str]
    results: Mapping[str, str]
    seconds: float
    jobs: int


def run(options: Mapping[str, Any], context: BenchmarkContext) -> dict[str, Any]:
    """Rows by command: what became of each way to be interrupted."""
    kills = whole_number(options["kills"], "problem.kills", least=0)
    folder = context.folder.absolute() / "trials"
    all_lines = _lines(folder)
    lines = {name: all_lines[name] for name in names(options, "commands", all_lines)}
    done = Checkpointed.load(context.folder, "kills", {"seed": context.seed})
    ways: list[tuple[str, Callable[[Trial, Path, random.Random], list[str]]]] = [
        *((f"SIGKILL {k}", _killed) for k in range(kills)),
        *((f"{name} {k}", _signalled(number)) for name, number in SIGNALS.items() for k in range(2)),
        ("copied 0", _copied),
        ("full disk 0", _full_disk),
        ("read-only 0", _read_only),
        ("two at once 0", _two_at_once),
    ]
    faults: dict[str, dict[str, list[str]]] = {}
    for number, (name, line) in enumerate(lines.items()):
        trial = _reference(name, line, folder)
        for k, (way, interrupt) in enumerate(ways):
            context.advance(number * len(ways) + k, len(ways) * len(lines), f"{name}: {way}")
            draw = random.Random(f"{context.seed} {name} {way}")  # noqa: S311  # no secret

            def row(trial: Trial = trial, draw: random.Random = draw, interrupt: Any = interrupt) -> list[str]:
                return _tried(trial, folder / "trial", draw, interrupt)

            faults.setdefault(name, {})[way] = done.row(f"{name}: {way}", row)
    return {"commands": {name: _summed(of) for name, of in faults.items()}}


def draw(document: Mapping[str, Any], folder: Path) -> list[Path]:
    """None: the table says it."""
    return []


def tables(document: Mapping[str, Any]) -> list[Table]:
    """Trials and faults by command."""
    table = Table(title="Interrupted, looked at, run again")
    for column in ("command", "interrupted by", "trials", "without fault", "not possible here"):
        table.add_column(
            column, justify="right" if "trials" in column or "out" in column or "not" in column else "left"
        )
    for name, ways in document["results"]["commands"].items():
        for way, row in ways["ways"].items():
            table.add_row(name, way, *(str(row[key]) for key in ("trials", "without_fault", "not_possible")))
    return [table]


def _lines(folder: Path) -> dict[str, list[str]]:
    """The commands, and the files that they read."""
    folder.mkdir(parents=True, exist_ok=True)
    model = _law()
    body = Body.cube(side=0.25, centre=(0.5, 0.25, 0.5), particles_per_edge=4)
    for k in range(2):
        scene = Scene(body, model, velocity=(0.3, -1.5, 0), youngs_modulus=1e5 * (k + 1), name=f"body_{k}")
        scene.simulate(40, 5, deformation=True).save(folder / f"body_{k}.h5")
    files = ",".join(str(folder / f"body_{k}.h5") for k in range(2))
    fit = [*TRAINING, *SHORT, *PLAIN, f"data.trajectories=[{files}]", "training.iterations=12"]
    observed = [f"observation.file={folder / 'body_0.h5'}", "law=analytic", "initial_guess.youngs_modulus=2e5"]
    return {
        "generate": ["generate", *BODY, *PLAIN, "data.train_scenes=8", "data.validation_scenes=4", "output=result"],
        "train": ["train", *fit, "output=result"],
        "multirun": ["train", "--multirun", *fit, f"seed={','.join(SEEDS)}", "training.iterations=6", "name=sweep"],
        "estimate": ["estimate", "material=elasticity", *observed, "picture=false", *PLAIN, "output=result.json"],
    }


def _law() -> ConstitutiveModel:
    material = material_named("elasticity")
    return ConstitutiveModel(material, analytic_laws(material), material.ranges, "analytic")


def _reference(name: str, line: Sequence[str], folder: Path) -> Trial:
    """The command uninterrupted: twice, the second time with kernels that are made."""
    place = folder / "reference" / name
    seconds = 0.0
    for _ in range(2):
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir(parents=True)
        began = time.monotonic()
        if (ended := _run(line, place)).status:
            raise UserError(f"{name} fails uninterrupted: {ended.in_words}")
        seconds = time.monotonic() - began
    return Trial(name, line, results_of(place), seconds, len(SEEDS) if "--multirun" in line else 1)


def _tried(
    trial: Trial, place: Path, draw: random.Random, interrupt: Callable[[Trial, Path, random.Random], list[str]]
) -> list[str]:
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir(parents=True)
    return interrupt(trial, place, draw)


def _killed(trial: Trial, place: Path, draw: random.Random) -> list[str]:
    moment = draw.uniform(0.0, trial.seconds)
    _interrupted(trial.line, place, signal.SIGKILL, moment)
    return broken_files(place) + _again(trial, place)


def _signalled(number: int) -> Callable[[Trial, Path, random.Random], list[str]]:
    def interrupt(trial: Trial, place: Path, draw: random.Random) -> list[str]:
        # before Python has begun to listen a signal ends it as it ends any process
        ended = _interrupted(trial.line, place, number, draw.uniform(0.5, 1.0) * trial.seconds)
        right = ended.status in (0, STATUS[signal.Signals(number)], -number) and not ended.traceback
        return ([] if right else [ended.in_words]) + broken_files(place) + _again(trial, place)

    return interrupt


def _copied(trial: Trial, place: Path, draw: random.Random) -> list[str]:
    """Killed, copied elsewhere, and gone on with there."""
    _interrupted(trial.line, place, signal.SIGKILL, draw.uniform(0.6, 0.9) * trial.seconds)
    other = place.with_name("copied here")
    shutil.rmtree(other, ignore_errors=True)
    shutil.copytree(place, other)
    shutil.rmtree(place)
    return broken_files(other) + _again(trial, other)


def _full_disk(trial: Trial, place: Path, draw: random.Random) -> list[str]:
    """A file system that is too small, and then is not."""
    if not _mounted(place, f"size={SMALL_DISK}"):
        return ["not possible"]
    try:
        ended = _run(trial.line, place)
        right = ended.status == 1 and len(ended.errors) == trial.jobs and not ended.traceback
        faults = ([] if right else [ended.in_words]) + broken_files(place)
        _mounted(place, "remount,size=200m")
        return faults + _again(trial, place)
    finally:
        subprocess.run(["umount", str(place)], check=False)  # noqa: S603, S607


def _read_only(trial: Trial, place: Path, draw: random.Random) -> list[str]:
    if not _mounted(place, "size=200m,ro"):
        return ["not possible"]
    try:
        ended = _run(trial.line, place)
        right = ended.status == 2 and ended.errors and not ended.traceback
        _mounted(place, "remount,rw")
        return ([] if right else [ended.in_words]) + _again(trial, place)
    finally:
        subprocess.run(["umount", str(place)], check=False)  # noqa: S603, S607


def _two_at_once(trial: Trial, place: Path, draw: random.Random) -> list[str]:
    """Both end well, or one is refused (a sweep in the jobs that the other does); together they leave what one does."""
    both = [_started(trial.line, place) for _ in range(2)]
    ended = [_ended(process) for process in both]
    right = all(one.status in (0, 2) and not one.traceback for one in ended)
    faults = [] if right else [one.in_words for one in ended]
    return faults + other_results(trial.results, results_of(place)) + _again(trial, place)


def _again(trial: Trial, place: Path) -> list[str]:
    """What is wrong after the same command once more."""
    ended = _run(trial.line, place)
    if ended.status or ended.traceback:
        return [f"again: {ended.in_words}"]
    return other_results(trial.results, results_of(place))


def _interrupted(line: Sequence[str], place: Path, number: int, moment: float) -> Ended:
    """The command with a signal to it, and to the compilers that it started, after so many seconds."""
    process = _started(line, place)
    try:
        process.wait(moment)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, number)
    return _ended(process)


def _run(line: Sequence[str], place: Path) -> Ended:
    return _ended(_started(line, place))


def _started(line: Sequence[str], place: Path) -> "subprocess.Popen[str]":
    entry, *arguments = line
    # our own module with our own arguments, no shell
    return subprocess.Popen(  # noqa: S603
        [sys.executable, "-m", f"pcnclaws.{entry}", *arguments],
        cwd=place,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"},
    )


def _ended(process: "subprocess.Popen[str]") -> Ended:
    try:
        _, said = process.communicate(timeout=SECONDS)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        return Ended(-signal.SIGKILL, [f"no end within {SECONDS:g} s"], traceback=False)
    errors = [line for line in said.splitlines() if line.startswith("error:")]
    return Ended(process.returncode, errors, "Traceback" in said)


def _mounted(place: Path, options: str) -> bool:
    """Whether a file system in memory could be mounted."""
    command = ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(place)]
    return subprocess.run(command, capture_output=True, check=False).returncode == 0  # noqa: S603


def _summed(rows: Mapping[str, Sequence[str]]) -> dict[str, Any]:
    ways: dict[str, Counter[str]] = {}
    for name, faults in rows.items():
        count = ways.setdefault(name.rpartition(" ")[0], Counter(trials=0, without_fault=0, not_possible=0))
        impossible = faults == ["not possible"]
        count.update(trials=1, without_fault=int(not faults), not_possible=int(impossible))
    found = {name: list(faults) for name, faults in rows.items() if faults and faults != ["not possible"]}
    return {"ways": {name: dict(count) for name, count in ways.items()}, "faults": found}


SIGNALS = {"Ctrl-C": signal.SIGINT, "SIGTERM": signal.SIGTERM}
