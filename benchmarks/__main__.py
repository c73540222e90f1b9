"""Benchmarks: python -m benchmarks problem=step_cost."""

import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Column

from benchmarks.context import BenchmarkContext
from benchmarks.document import measure, read_document
from benchmarks.problems import PROBLEMS
from benchmarks.yardstick import Yardstick
from pcnclaws.commands import launcher
from pcnclaws.commands.configuration import device_from, whole_number
from pcnclaws.commands.outputs import check_ending
from pcnclaws.commands.runs import laws_for
from pcnclaws.commands.typed_configs import BenchmarkConfig
from pcnclaws.data.locks import written_alone

# Width of the tables where the output is not a terminal.
PLAIN_WIDTH = 120


def benchmark(config: BenchmarkConfig) -> None:
    """Measures the configured problem and leaves its numbers, as JSON, and its pictures in the folder `output`."""
    folder = Path(config.output)
    check_ending("output", folder)
    with written_alone(folder, f"output={folder}"):
        _benchmark(config, folder, str(config.problem["name"]))


def _benchmark(config: BenchmarkConfig, folder: Path, name: str) -> None:
    document = folder / f"{name}.json"
    if config.redraw is None:
        measured = _measure(config, folder, name)
        print(f"wrote {measured}")
    else:
        document = Path(str(config.redraw))
    found = read_document(document, name)
    _print_tables(name, found)
    for picture in PROBLEMS[name].draw(found, folder):
        print(f"wrote {picture}")


def _measure(config: BenchmarkConfig, folder: Path, name: str) -> Path:
    torch.set_num_threads(whole_number(config.threads, "threads"))
    device, seed = device_from(config.device), whole_number(config.seed, "seed", least=0)
    options = dict(config.problem)
    del options["name"]
    with _progress(name) as advance:
        return measure(name, options, BenchmarkContext(device, seed, folder, advance, Yardstick(device), laws_for))


@contextmanager
def _progress(name: str) -> Iterator[Callable[[int, int, str], None]]:
    """A bar with the time left on stderr, gone when done; one line at the start where stderr is no terminal."""
    console = Console(stderr=True)
    columns = (
        TextColumn(name),
        BarColumn(bar_width=16),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        TextColumn("{task.description}", table_column=Column(ratio=1, no_wrap=True, overflow="ellipsis")),
    )
    # the rows of a problem differ in length: the estimate looks at all of them
    bar = Progress(
        *columns,
        console=console,
        expand=True,
        transient=True,
        disable=not console.is_terminal,
        speed_estimate_period=1e6,
    )
    with bar:
        task = bar.add_task("", total=None, start=False)
        started = False

        def advance(done: int, total: int, what: str) -> None:
            nonlocal started
            if not started:
                started = True
                bar.start_task(task)
                if not console.is_terminal:
                    print(f"{name}: {total} measurements", file=sys.stderr)
            bar.update(task, completed=done, total=total, description=what)

        yield advance


def _print_tables(name: str, document: Mapping[str, Any]) -> None:
    console = Console()
    if not console.is_terminal:
        console = Console(width=PLAIN_WIDTH)
    for table in PROBLEMS[name].tables(document):
        console.print(table)


def main() -> None:
    """The command."""
    launcher.main(benchmark, "benchmark")


if __name__ == "__main__":
    main()
