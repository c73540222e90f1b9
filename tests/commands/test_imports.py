"""What takes its time to load is loaded by the commands that need it."""

import subprocess
import sys

import pytest

HEAVY = ("torch", "lightning", "matplotlib", "scipy", "h5py", "tensorboard")
REFUSED = """
import sys
from importlib import import_module
from pcnclaws.commands import launcher
for entry in ("simulate", "generate", "train", "evaluate", "estimate", "observe", "calibrate"):
    task = getattr(import_module(f"pcnclaws.{entry}"), entry)
    assert launcher.run(task, entry, ["sizeof=3"]) == 2
print(*sys.modules)
"""
SIMULATE = """
import sys
from pcnclaws.commands import simulation_command
print(*sys.modules)
"""


def loaded(code: str) -> set[str]:
    """The packages that a process has loaded in the end, of those that take their time."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return {module.partition(".")[0] for module in done.stdout.split()} & {*HEAVY, "numpy", "pcnclaws"}


def test_refused_options_load_nothing_that_computes() -> None:
    assert loaded(REFUSED) == {"pcnclaws"}


@pytest.mark.parametrize("package", ["lightning", "tensorboard"])
def test_a_simulation_loads_nothing_that_trains(package: str) -> None:
    assert package not in loaded(SIMULATE)
