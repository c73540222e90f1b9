"""Processes of one training, which divide its batches: this one writes, those beside it only compute."""

import logging
import multiprocessing
import os
import signal
import socket
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import torch

from pcnclaws.errors import JobsLost

Thing = TypeVar("Thing")
# Seconds for the others to end after the last step, before they are killed.
PATIENCE = 20.0
# Seconds in which one that has gone is known to have.
GRACE = 2.0


@contextmanager
def beside(count: int, target: Callable[..., object], *arguments: Any) -> Iterator[None]:
    """Runs `target` with the arguments in count - 1 processes for the block, as ranks from 1; this one is rank 0.

    All of them have the environment in which Lightning joins them, and share the threads of this one. They are gone
    when the block ends, however it does.

    target     a function of a module, with arguments that can be pickled
    raises     JobsLost where the block fails since one of them has gone
    """
    if count == 1:
        yield
        return
    threads = torch.get_num_threads()
    environment = {
        "MASTER_ADDR": "127.0.0.1",
        "MASTER_PORT": str(_free_port()),
        "WORLD_SIZE": str(count),
        "NODE_RANK": "0",
        "LOCAL_RANK": "0",
        "OMP_NUM_THREADS": str(max(threads // count, 1)),
    }
    before = {name: os.environ.get(name) for name in environment}
    os.environ.update(environment)
    torch.set_num_threads(max(threads // count, 1))
    context = multiprocessing.get_context("spawn")  # a fork of a process with threads, or with a GPU, does not work
    others = [
        context.Process(target=_run, args=(rank, environment, target, arguments), daemon=True)
        for rank in range(1, count)
    ]
    try:
        for process in others:
            process.start()
        try:
            yield
        except RuntimeError as fault:  # what the connection to a process says that has gone
            for process in others:
                process.join(GRACE)  # the connection knows before the system
            lost = [process.exitcode for process in others if process.exitcode]
            if not lost:
                raise
            raise JobsLost(
                f"a process of the training has gone (exit status {lost[0]}); the same command goes on"
            ) from fault
        for process in others:
            process.join(PATIENCE)
    finally:
        for process in others:
            if process.is_alive():
                process.kill()
                process.join()
        if torch.distributed.is_initialized():
            torch.distributed.destroy_process_group()
        torch.set_num_threads(threads)
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def gathered(own: Sequence[Thing], count: int) -> list[Thing]:
    """What all of `count` processes have, where each has every count-th thing: in the order of one process."""
    if count == 1:
        return list(own)
    shares: list[Sequence[Thing]] = [()] * count
    torch.distributed.all_gather_object(shares, own)
    longest = max(map(len, shares))
    return [share[place] for place in range(longest) for share in shares if place < len(share)]


def _run(rank: int, environment: dict[str, str], target: Callable[..., object], arguments: tuple[Any, ...]) -> None:
    """What a process beside the first one does. It says nothing: the first one says the same."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C comes to all; the first one ends the others
    os.environ.update(environment | {"LOCAL_RANK": str(rank)})
    torch.set_num_threads(int(environment["OMP_NUM_THREADS"]))
    logging.disable(logging.WARNING)
    with Path(os.devnull).open("w") as nowhere:
        sys.stdout = nowhere
        target(*arguments)


def _free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])
