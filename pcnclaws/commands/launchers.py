"""Launchers of a sweep: jobs in this process, in others of this machine, or in the queue of a batch system."""

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser

from pcnclaws.atomic import one_line_writing
from pcnclaws.errors import JobsLost, UserError, not_installed

LAUNCHER, SWEEPER, OUTPUTS = "hydra/launcher", "hydra/sweeper", "paths.outputs"
# Those of conf/hydra/launcher, and those of the plugins that they build on.
JOBLIB = ("processes", "joblib")
SUBMITIT = ("slurm", "slurm_locally", "submitit_slurm", "submitit_local")
SEARCH = "search"
# Whose errors say that a process has gone, not a job.
PACKAGES = ("joblib", "submitit")


def check_launcher(overrides: Sequence[str], multirun: bool) -> None:
    """Refuses a launcher or sweeper whose package is not installed, or that no sweep would use, with a UserError."""
    values = _values(overrides)
    for group in (LAUNCHER, SWEEPER):
        if group in values and not multirun:
            raise UserError(f"{group}={values[group]} has no effect without --multirun; accepted: both, or neither")
    launcher = values.get(LAUNCHER)
    if launcher in JOBLIB and not _is_there("hydra_plugins.hydra_joblib_launcher"):
        raise not_installed(f"{LAUNCHER}={launcher}", "hydra-joblib-launcher", "sweep", "no launcher")
    if launcher in SUBMITIT and not _is_there("hydra_plugins.hydra_submitit_launcher"):
        raise not_installed(f"{LAUNCHER}={launcher}", "hydra-submitit-launcher", "sweep", "no launcher")
    for one in OverridesParser.create().parse_overrides(list(overrides)):
        if one.is_interval_sweep() and SWEEPER not in values:
            beside = f"{SWEEPER}={SEARCH}"
            raise UserError(f"{one.input_line} is an interval to search in; accepted: a list of values, or {beside}")
    if values.get(SWEEPER) == SEARCH and not _is_there("optuna"):
        raise not_installed(f"{SWEEPER}={SEARCH}", "optuna", "sweep", "lists of values")


@contextmanager
def sweep_folder(entry: str, overrides: Sequence[str]) -> Iterator[Path]:
    """The folder of a sweep for the block, which goes with it, or stays where jobs log and may outlive it.

    entry  name of the command
    """
    values = _values(overrides)
    if values.get(LAUNCHER) not in SUBMITIT:
        with tempfile.TemporaryDirectory() as folder:
            yield Path(folder)
        return
    sweeps = Path(str(values.get(OUTPUTS, "outputs"))).absolute() / "sweeps"
    with one_line_writing(sweeps):
        sweeps.mkdir(parents=True, exist_ok=True)
        folder = Path(tempfile.mkdtemp(prefix=f"{entry}_", dir=sweeps))
    try:
        yield folder
    finally:
        with suppress(OSError):  # where no job began, it is empty
            folder.rmdir()


def quoted(path: Path) -> str:
    """A path as a value of Hydra's grammar."""
    return "'" + str(path).replace("'", r"\'") + "'"


def lost_jobs(error: Exception) -> JobsLost:
    """What a launcher says when processes have gone, in one line; any other error is raised."""
    if type(error).__module__.partition(".")[0] not in PACKAGES:
        raise error
    words = str(error).strip().partition("\n")[0][:200]
    return JobsLost(f"a process of the sweep has gone ({words}); the same command runs what is missing")


def _values(overrides: Sequence[str]) -> dict[str, Any]:
    """The values of the options by name, but for those of a sweep."""
    parsed = OverridesParser.create().parse_overrides(list(overrides))
    return {one.key_or_group: one.value() for one in parsed if not one.is_sweep_override()}


def _is_there(module: str) -> bool:
    try:
        return find_spec(module) is not None
    except ModuleNotFoundError:  # of the package that holds it
        return False
