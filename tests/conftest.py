"""What all tests share: one thread each, and commands run as a user runs them or, faster, in this process."""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import torch
from hydra.core.config_store import ConfigStore

from pcnclaws.commands import launcher
from pcnclaws.compiled.backend import using_backend
from pcnclaws.compiled.build import find_compiler
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.laws.parameters import PARAMETERS
from pcnclaws.laws.registry import NETWORKS

os.environ["OMP_NUM_THREADS"] = "1"
torch.set_num_threads(1)


class Outcome(NamedTuple):
    """What a command left: its exit status and what it said."""

    status: int
    out: str
    err: str


@pytest.fixture(params=["torch", "compiled"])
def each_backend(request: pytest.FixtureRequest) -> Iterator[str]:
    """Runs the test in PyTorch and, where there is a compiler, with the compiled kernels; the name of the backend."""
    if request.param == "compiled" and find_compiler() is None:
        pytest.skip("needs a C++ compiler")  # where there is one that fails, the test fails, too
    with using_backend(request.param):
        yield request.param


# Of a test of `each_backend` that takes PyTorch long, and that others cover in kind.
SLOW_IN_PYTORCH = pytest.mark.parametrize(
    "each_backend", [pytest.param("torch", marks=pytest.mark.slow), "compiled"], indirect=True
)


@pytest.fixture
def own_registry() -> Iterator[None]:
    """Lets the test register what it likes: what was known before is known after it, and nothing else."""
    tables: list[dict[str, Any]] = [MATERIALS, NETWORKS, PARAMETERS]
    before = [table.copy() for table in tables]
    yield
    for table, known in zip(tables, before, strict=True):
        for name in table.keys() - known.keys():
            for choices in filter(lambda one: isinstance(one, dict), ConfigStore.instance().repo.values()):
                choices.pop(f"{name}.yaml", None)
        table.clear()
        table.update(known)


@pytest.fixture
def in_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., Outcome]:
    """Runs a task under the launcher in this process, from an empty folder."""
    monkeypatch.chdir(tmp_path)

    def run(task: Callable[[Any], None], entry: str, *arguments: str) -> Outcome:
        capsys.readouterr()
        status = launcher.run(task, entry, arguments)
        said = capsys.readouterr()
        return Outcome(status, said.out, said.err)

    return run


@pytest.fixture
def command(tmp_path: Path) -> Callable[..., Outcome]:
    """Runs `python -m pcnclaws.<entry>` in a process of its own, from an empty folder."""

    def run(entry: str, *arguments: str) -> Outcome:
        done = subprocess.run(
            [sys.executable, "-m", f"pcnclaws.{entry}", *arguments], cwd=tmp_path, capture_output=True, text=True
        )
        return Outcome(done.returncode, done.stdout, done.stderr)

    return run


@pytest.fixture
def on_the_path(tmp_path: Path) -> dict[str, str]:
    """An environment in which `pcnclaws` is the command that a wheel installs."""
    program = tmp_path / "bin" / "pcnclaws"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m pcnclaws "$@"\n')
    program.chmod(0o755)
    path = os.pathsep.join((str(program.parent), os.environ["PATH"]))
    modules = os.pathsep.join((str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")))
    return {**os.environ, "PATH": path, "PYTHONPATH": modules}


@pytest.fixture
def in_a_shell(tmp_path: Path, on_the_path: dict[str, str]) -> Callable[[str], None]:
    """Runs lines of bash in an empty folder, and fails where one of them fails."""
    bash = shutil.which("bash")
    assert bash is not None

    def run(lines: str) -> None:
        done = subprocess.run([bash, "-e", "-c", lines], cwd=tmp_path, env=on_the_path, capture_output=True, text=True)
        assert done.returncode == 0, f"{lines}\n{done.stdout}\n{done.stderr}"

    return run
