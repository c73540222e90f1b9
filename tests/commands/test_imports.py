"""What takes its time to load is loaded by the commands that need it."""

import subprocess
import sys
from pathlib import Path

HEAVY = ("torch", "lightning", "matplotlib", "PIL", "scipy", "h5py", "tensorboard", "trimesh", "numpy")
REFUSED = """
import sys
from importlib import import_module
from pcnclaws.commands import launcher
for entry in ("simulate", "generate", "train", "evaluate", "estimate", "observe", "calibrate", "export", "render"):
    task = getattr(import_module(f"pcnclaws.{entry}"), entry)
    assert launcher.run(task, entry, ["sizeof=3"]) == 2
    assert launcher.run(task, entry, ["--help"]) == 0
sys.stderr.write(" ".join(sys.modules))
"""
SIMULATED = """
import sys
from pcnclaws.commands import launcher
from pcnclaws.simulate import simulate
arguments = ["law=pretrained", "simulation.steps=1", "simulation.every=1", "picture=false", "output=x.h5"]
assert launcher.run(simulate, "simulate", arguments) == 0
sys.stderr.write(" ".join(sys.modules))
"""


def loaded(code: str, folder: Path) -> set[str]:
    """The packages that a process has loaded in the end, of those that take their time."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=folder)
    assert done.returncode == 0, done.stderr
    return {module.partition(".")[0] for module in done.stderr.split()} & {*HEAVY, "pcnclaws"}


def test_refused_options_and_help_load_nothing_that_computes(tmp_path: Path) -> None:
    assert loaded(REFUSED, tmp_path) == {"pcnclaws"}


def test_a_simulation_without_a_picture_loads_nothing_that_trains_or_draws(tmp_path: Path) -> None:
    assert loaded(SIMULATED, tmp_path) == {"torch", "numpy", "h5py", "pcnclaws"}
