"""The one launcher of all entry points: composes the configuration, runs the task, ends with an exit status.

    0  done
    1  the run failed: a diverged simulation, an interruption, a bug
    2  the user's input is wrong

Every failure is one line on stderr; a bug prints its traceback before it.
"""

import io
import os
import sys
import tempfile
import traceback
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr
from typing import NoReturn

import hydra
from hydra._internal.utils import get_args_parser
from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.types import RunMode
from omegaconf import DictConfig

from pcnclaws.composition import (
    CONFIG_ERRORS,
    HYDRA_VERSION_BASE,
    as_group_choices,
    checked,
    conf_folder,
    explain,
    register_resolvers,
    task_overrides,
)
from pcnclaws.errors import SimulationDiverged, UserError

FAILED, WRONG_INPUT = 1, 2
Task = Callable[[DictConfig], None]


def main(task: Task, entry: str) -> NoReturn:
    """Runs a task with the configuration that conf/<entry>.yaml and the command line give, and exits."""
    sys.exit(run(task, entry, sys.argv[1:]))


def run(task: Task, entry: str, arguments: Sequence[str]) -> int:
    """The exit status of an entry point with these command-line arguments.

    Under --multirun every job runs, whatever becomes of the others; the status is the largest of all jobs.
    """
    os.environ["HYDRA_FULL_ERROR"] = "1"  # Hydra raises its errors instead of printing them and exiting
    register_resolvers()
    jobs = Jobs(task, entry)
    try:
        flags, overrides = _split(arguments)
        jobs.overrides = overrides = as_group_choices(overrides)
        with tempfile.TemporaryDirectory() as sweep_folder:
            _launch(jobs, flags, [*overrides, f"hydra.sweep.dir={sweep_folder}"])
    except KeyboardInterrupt:
        print("error: interrupted", file=sys.stderr)
        return FAILED
    except (*CONFIG_ERRORS, ValueError) as error:  # Hydra raises ValueError, too, for what it cannot compose
        jobs.record(error if isinstance(error, UserError) else explain(entry, jobs.overrides, error))
    except Exception as error:
        jobs.record(error)
    return jobs.status


class Jobs:
    """The jobs of one command, and the worst of their exit statuses."""

    def __init__(self, task: Task, entry: str) -> None:
        self.task, self.entry = task, entry
        self.overrides: list[str] = []
        self.status = 0
        self._outputs: set[str] = set()
        self._recorded: list[Exception] = []

    def run(self, config: DictConfig) -> None:
        """One job, under Hydra."""
        multirun = HydraConfig.get().mode == RunMode.MULTIRUN
        overrides = task_overrides()
        try:
            self.task(self._checked(config, overrides))
        except Exception as error:
            self.record(error, f"job '{' '.join(overrides)}': " if multirun else "")
            if multirun:  # Hydra keeps the error until the other jobs have run
                raise

    def record(self, error: Exception, job: str = "") -> None:
        """Prints the error, once, and keeps its exit status if it is the worst."""
        if error in self._recorded:
            return
        self._recorded.append(error)
        self.status = max(self.status, WRONG_INPUT if isinstance(error, UserError) else FAILED)
        text = " ".join(str(error).split())
        if not isinstance(error, (UserError, SimulationDiverged)):
            traceback.print_exception(error)
            text = f"unexpected {type(error).__name__}: {text}"
        print(f"error: {job}{text}", file=sys.stderr)

    def _checked(self, config: DictConfig, overrides: list[str]) -> DictConfig:
        try:
            config = checked(self.entry, config, overrides)
        except CONFIG_ERRORS as error:
            raise explain(self.entry, overrides, error) from error
        output = os.path.realpath(str(config.output))
        if output in self._outputs:
            raise UserError(f"output={config.output} is shared with another job; accepted: one output for each job")
        self._outputs.add(output)
        return config


def _launch(jobs: Jobs, flags: list[str], overrides: list[str]) -> None:
    """Hydra composes and runs, one job or a sweep of them; it keeps no folder of its own."""
    _refuse_shared_output(overrides)

    def task(config: DictConfig) -> None:
        jobs.run(config)

    decorate = hydra.main(version_base=HYDRA_VERSION_BASE, config_path=str(conf_folder()), config_name=jobs.entry)
    typed = sys.argv
    sys.argv = [jobs.entry, *flags, *overrides]  # Hydra takes its arguments from nowhere else
    try:
        decorate(task)()
    finally:
        sys.argv = typed


def _split(arguments: Sequence[str]) -> tuple[list[str], list[str]]:
    """Hydra's flags and the overrides. Hydra alone would read flags only before or after all overrides."""
    complaint = io.StringIO()
    try:
        with redirect_stderr(complaint):
            overrides = get_args_parser().parse_intermixed_args(list(arguments)).overrides
    except SystemExit as end:
        if not end.code:
            raise
        raise UserError(complaint.getvalue().strip().rpartition("error: ")[2]) from None
    return [argument for argument in arguments if argument not in overrides], overrides


def _refuse_shared_output(overrides: Sequence[str]) -> None:
    """Refuses a sweep whose jobs would all write to the same place, before any of them runs."""
    parsed = OverridesParser.create().parse_overrides(list(overrides))
    if not any(override.is_sweep_override() for override in parsed):
        return
    for override in parsed:
        fixed = not override.is_sweep_override() and "${" not in str(override.value())
        if override.key_or_group == "output" and fixed:
            raise UserError(
                f"output={override.value()} is shared by the jobs of a sweep; accepted: no output= "
                "(one folder a job), or one that names a swept option, as in 'output=x_${seed}.h5'"
            )
