"""Jobs of a command: run one after another or as those of a sweep, each with its exit status."""

import errno
import os
import sys
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig
from rich.console import Console

from pcnclaws import guards
from pcnclaws.commands.choices import offer_choices
from pcnclaws.commands.composition import (
    CONFIG_ERRORS,
    checked,
    explain,
    is_of_sweep,
    register_resolvers,
    task_overrides,
)
from pcnclaws.commands.sweep_notes import SweepNotes, shared_output
from pcnclaws.commands.sweeps import Job, sweep_table
from pcnclaws.commands.typed_configs import Command
from pcnclaws.errors import CannotWrite, JobsLost, SimulationDiverged, UserError, is_full, reason

FAILED, WRONG_INPUT = 1, 2
# Width of the table of a sweep where the output is not a terminal: folders are long.
PLAIN_WIDTH = 160
# Where launchers that do not print what a job says keep it, in the folder of the sweep.
LOGS = "logs"
# What a command does with its typed configuration; it may return numbers that a sweep shows of it, by name and unit.
Task = Callable[[Any], Mapping[str, float | None] | None]


class Jobs:
    """The jobs of one command, and the worst of their exit statuses.

    folder  of a sweep, where jobs in other processes leave their notes
    """

    def __init__(self, task: Task, entry: str) -> None:
        self.task, self.entry = task, entry
        self.overrides: list[str] = []
        self.swept: list[str] = []
        self.folder = Path()
        self.status = 0
        self._outputs: set[str] = set()
        self._done: list[Job] = []
        self._process = os.getpid()

    def run(self, config: DictConfig) -> Job:
        """One job, under Hydra, whose launcher may have taken it to another process."""
        if os.getpid() != self._process:
            return self._run_elsewhere(config)
        job = self._run(config)
        self._keep(job, is_of_sweep())
        return job

    def record(self, error: Exception) -> None:
        """Prints an error that is not that of a job, and keeps its exit status if it is the worst."""
        status, line = _in_one_line(error)
        self._say(status, line)

    def gather(self) -> None:
        """Takes over what became of the jobs in other processes."""
        for job in SweepNotes(self.folder).jobs():
            self._keep(job, of_sweep=True)

    def remember(self, job: Job) -> None:
        """Adds a job of the same sweep that ran before to the table."""
        self._done.append(job)
        self.status = max(self.status, job.status)

    def show(self) -> None:
        """Prints the table of a sweep."""
        if self.swept and self._done:
            console = Console() if Console().is_terminal else Console(width=PLAIN_WIDTH)
            console.print(sweep_table(self._done, self.swept))
        if (logs := self.folder / LOGS).is_dir():
            print(f"logs of the jobs: {logs}")

    def _run(self, config: DictConfig) -> Job:
        overrides, output = task_overrides(), ""
        try:
            options = self._checked(config, overrides)
            output = str(options.output)
            self._claim(output)
            guards.restart()
            numbers = self.task(options) or {}
        except Exception as error:
            status, line = _in_one_line(error)
            return Job(overrides, status, output, {}, line)
        if words := guards.in_words():
            print(f"guards: {words}", file=sys.stderr)
        return Job(overrides, 0, output, numbers)

    def _run_elsewhere(self, config: DictConfig) -> Job:
        overrides, number, notes = task_overrides(), HydraConfig.get().job.num, SweepNotes(self.folder)
        register_resolvers()
        offer_choices(overrides)
        notes.begin(number, overrides)
        job = self._run(config)
        notes.end(number, job)
        return job

    def _keep(self, job: Job, of_sweep: bool) -> None:
        self._done.append(job)
        if job.error:
            self._say(job.status, f"job '{' '.join(job.overrides)}': {job.error}" if of_sweep else job.error)

    def _say(self, status: int, line: str) -> None:
        self.status = max(self.status, status)
        print(f"error: {line}", file=sys.stderr)

    def _checked(self, config: DictConfig, overrides: list[str]) -> Command:
        try:
            return checked(self.entry, config, overrides, self.swept)
        except CONFIG_ERRORS as error:
            raise explain(self.entry, overrides, error) from error

    def _claim(self, output: str) -> None:
        if os.getpid() != self._process:
            SweepNotes(self.folder).claim(output, HydraConfig.get().job.num)
            return
        place = os.path.realpath(output)
        if place in self._outputs:
            raise shared_output(output)
        self._outputs.add(place)


def _in_one_line(error: Exception) -> tuple[int, str]:
    """The exit status of an error, and its line; the traceback of a bug is printed."""
    text = " ".join(str(error).split())
    if isinstance(error, OSError) and error.errno == errno.ENAMETOOLONG:
        error = UserError(f"'{str(error.filename)[:40]}...' is no path (file name too long); accepted: shorter names")
        text = str(error)
    elif isinstance(error, OSError) and is_full(error):
        text = f"{error.filename or 'a file'} cannot be written ({reason(error)})"
    elif not isinstance(error, (UserError, SimulationDiverged, CannotWrite, JobsLost)):
        traceback.print_exception(error)
        text = f"unexpected {type(error).__name__}: {text}"
    return WRONG_INPUT if isinstance(error, UserError) else FAILED, text
