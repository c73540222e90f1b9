"""Jobs of a command: run one after another or as those of a sweep, each with its exit status."""

import os
import sys
import traceback
from collections.abc import Callable, Mapping
from typing import Any

from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig
from rich.console import Console

from pcnclaws import guards
from pcnclaws.commands.composition import CONFIG_ERRORS, checked, explain, task_overrides
from pcnclaws.commands.sweeps import Job, sweep_table
from pcnclaws.commands.typed_configs import Command
from pcnclaws.errors import CannotWrite, SimulationDiverged, UserError, is_full, reason

FAILED, WRONG_INPUT = 1, 2
# Width of the table of a sweep where the output is not a terminal: folders are long.
PLAIN_WIDTH = 160
# What a command does with its typed configuration; it may return numbers that a sweep shows of it, by name and unit.
Task = Callable[[Any], Mapping[str, float | None] | None]


class Jobs:
    """The jobs of one command, and the worst of their exit statuses."""

    def __init__(self, task: Task, entry: str) -> None:
        self.task, self.entry = task, entry
        self.overrides: list[str] = []
        self.swept: list[str] = []
        self.status = 0
        self._outputs: set[str] = set()
        self._recorded: list[Exception] = []
        self._done: list[Job] = []

    def run(self, config: DictConfig) -> None:
        """One job, under Hydra."""
        multirun = HydraConfig.get().mode == RunMode.MULTIRUN
        overrides, output = task_overrides(), ""
        try:
            options = self._checked(config, overrides)
            output = str(options.output)
            guards.restart()
            numbers = self.task(options) or {}
            if words := guards.in_words():
                print(f"guards: {words}", file=sys.stderr)
            self._done.append(Job(overrides, 0, output, numbers))
        except Exception as error:
            status = self.record(error, f"job '{' '.join(overrides)}': " if multirun else "")
            self._done.append(Job(overrides, status, output, {}))
            if multirun:  # Hydra keeps the error until the other jobs have run
                raise

    def record(self, error: Exception, job: str = "") -> int:
        """Prints the error, once, and keeps its exit status if it is the worst; returns its own."""
        status = WRONG_INPUT if isinstance(error, UserError) else FAILED
        if error in self._recorded:
            return status
        self._recorded.append(error)
        self.status = max(self.status, status)
        text = " ".join(str(error).split())
        if isinstance(error, OSError) and is_full(error):
            text = f"{error.filename or 'a file'} cannot be written ({reason(error)})"
        elif not isinstance(error, (UserError, SimulationDiverged, CannotWrite)):
            traceback.print_exception(error)
            text = f"unexpected {type(error).__name__}: {text}"
        print(f"error: {job}{text}", file=sys.stderr)
        return status

    def show(self) -> None:
        """Prints the table of a sweep."""
        if self.swept and self._done:
            console = Console() if Console().is_terminal else Console(width=PLAIN_WIDTH)
            console.print(sweep_table(self._done, self.swept))

    def _checked(self, config: DictConfig, overrides: list[str]) -> Command:
        try:
            options = checked(self.entry, config, overrides, self.swept)
        except CONFIG_ERRORS as error:
            raise explain(self.entry, overrides, error) from error
        output = os.path.realpath(str(options.output))
        if output in self._outputs:
            raise UserError(f"output={options.output} is shared with another job; accepted: one output for each job")
        self._outputs.add(output)
        return options
