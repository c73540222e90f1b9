"""Launcher of all entry points: composes the configuration, runs the task, ends with an exit status.

    0    done
    1    the run failed: a diverged simulation, Ctrl-C (SIGINT), a full disk, a bug
    2    the user's input is wrong
    143  ended by SIGTERM

Every failure is one line on stderr; a bug prints its traceback before it.
"""

import io
import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stderr
from typing import NoReturn

import hydra
from hydra._internal.utils import get_args_parser
from hydra.core.override_parser.overrides_parser import OverridesParser

from pcnclaws.commands.choices import offer_choices
from pcnclaws.commands.composition import (
    CONFIG_ERRORS,
    HYDRA_VERSION_BASE,
    as_hydra_reads_them,
    conf_folder,
    explain,
    register_resolvers,
)
from pcnclaws.commands.folder_names import swept_options
from pcnclaws.commands.help import help_text
from pcnclaws.commands.jobs import FAILED, Jobs, Task
from pcnclaws.commands.launchers import check_launcher, lost_jobs, quoted, sweep_folder
from pcnclaws.commands.signals import signals_end_it
from pcnclaws.errors import Interrupted, UserError, is_full

HELP, MULTIRUN = {"--help", "-h"}, {"--multirun", "-m"}
TERMINATED = 128 + signal.SIGTERM


def main(task: Task, entry: str) -> NoReturn:
    """Runs a task with the configuration that conf/<entry>.yaml and the command line give, and exits."""
    sys.exit(run(task, entry, sys.argv[1:]))


def run(task: Task, entry: str, arguments: Sequence[str]) -> int:
    """The exit status of an entry point with these command-line arguments.

    Under --multirun every job runs, whatever becomes of the others; the status is the largest of all jobs. A signal
    ends all of them.
    """
    os.environ["HYDRA_FULL_ERROR"] = "1"  # Hydra raises its errors instead of printing them and exiting
    register_resolvers()
    jobs = Jobs(task, entry)
    try:
        with signals_end_it(), _threads_without_traceback():
            _run(jobs, arguments)
            jobs.show()
            _flush(jobs)
    except (Interrupted, KeyboardInterrupt) as end:
        return _said(end)
    return jobs.status


def say(text: str) -> None:
    """Prints an answer; whoever has read enough (`| head`) hears no more."""
    try:
        print(text, flush=True)
    except BrokenPipeError:
        _listen_no_more()


def _run(jobs: Jobs, arguments: Sequence[str]) -> None:
    try:
        flags, overrides = _split(arguments)
        jobs.overrides = overrides = as_hydra_reads_them(overrides)
        offer_choices(overrides)
        if HELP & set(flags):
            print(help_text(jobs.entry, jobs.task.__doc__, overrides))
            return
        jobs.swept = swept_options(overrides)
        check_launcher(overrides, multirun=not MULTIRUN.isdisjoint(flags))
        with sweep_folder(jobs.entry, overrides) as jobs.folder:
            try:
                _launch(jobs, flags, [*overrides, f"hydra.sweep.dir={quoted(jobs.folder)}"])
            except Exception as error:
                jobs.record(lost_jobs(error))
            jobs.gather()
    except BrokenPipeError:  # `| head` has read enough
        _listen_no_more()
    except (*CONFIG_ERRORS, ValueError) as error:  # Hydra raises ValueError, too, for what it cannot compose
        jobs.record(error if isinstance(error, UserError) else explain(jobs.entry, jobs.overrides, error))
    except Exception as error:
        jobs.record(error)


def _flush(jobs: Jobs) -> None:
    """Writes what was printed; a file that it goes to may be full."""
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        _listen_no_more()
    except OSError as error:
        _listen_no_more()
        error.filename = "the standard output"
        if not jobs.status:
            jobs.record(error)


def _listen_no_more() -> None:
    """Leads the standard output nowhere: Python flushes it once more at its end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@contextmanager
def _threads_without_traceback() -> Iterator[None]:
    """A thread that finds no room (TensorBoard's) ends without a word: its error comes to the main thread, too."""
    hook = threading.excepthook

    def quiet(thrown: threading.ExceptHookArgs) -> None:
        if not (isinstance(thrown.exc_value, OSError) and is_full(thrown.exc_value)):
            hook(thrown)

    threading.excepthook = quiet
    try:
        yield
    finally:
        threading.excepthook = hook


def _said(end: Interrupted | KeyboardInterrupt) -> int:
    """The exit status of an interruption, after its line."""
    words = "interrupted" if isinstance(end, KeyboardInterrupt) else str(end)
    print("error:", "; ".join([words, *getattr(end, "__notes__", ())]), file=sys.stderr)
    return TERMINATED if isinstance(end, Interrupted) and end.number == signal.SIGTERM else FAILED


def _launch(jobs: Jobs, flags: list[str], overrides: list[str]) -> None:
    """Hydra composes and runs, one job or a sweep of them; it keeps no folder of its own."""
    _refuse_shared_output(overrides)

    decorate = hydra.main(version_base=HYDRA_VERSION_BASE, config_path=str(conf_folder()), config_name=jobs.entry)
    typed = sys.argv
    sys.argv = [jobs.entry, *flags, *overrides]  # Hydra takes its arguments from nowhere else
    try:
        decorate(jobs.run)()
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
