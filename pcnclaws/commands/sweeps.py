"""Sweep table: the jobs of a sweep, what was swept, what came out and where it is."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table

STATUS = {0: "done", 1: "failed", 2: "refused"}


class Job(NamedTuple):
    """One job of a sweep.

    overrides  as they were written
    status     its exit status
    output     what its option `output` says
    numbers    what its command counts as its result, by name and unit
    error      why it failed, in one line
    """

    overrides: Sequence[str]
    status: int
    output: str
    numbers: Mapping[str, float | None]
    error: str = ""


def sweep_table(jobs: Sequence[Job], swept: Sequence[str]) -> Table:
    """One line a job: the swept options, the numbers of its result, its status, and its output in the common folder."""
    folders = [Path(job.output).absolute().parent for job in jobs if job.output]
    common = os.path.commonpath(folders) if folders else str(Path.cwd())
    title = f"sweep of {len(jobs)} jobs in {os.path.relpath(common)}"
    table = Table(title=escape(title), title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    names = list(dict.fromkeys(name for job in jobs for name in job.numbers))
    for option in swept:
        table.add_column(escape(option), overflow="fold")
    for name in names:
        table.add_column(escape(name), justify="right")
    table.add_column("status")
    table.add_column("output", overflow="fold")
    for job in jobs:
        values = {name.lstrip("+"): value for name, _, value in (one.partition("=") for one in job.overrides)}
        chosen = [escape(values.get(option, "")) for option in swept]
        table.add_row(
            *chosen,
            *(_number(job.numbers.get(name)) for name in names),
            STATUS[job.status],
            escape(_within(common, job.output)),
        )
    return table


def _within(folder: str, output: str) -> str:
    return os.path.relpath(output, folder) if output else "-"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"
