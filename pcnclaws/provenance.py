"""Provenance of a result: enough to make it again."""

import os
import platform
import shlex
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import torch

from pcnclaws.version import __version__

REPOSITORY = Path(__file__).resolve().parent.parent


def provenance(seed: int | None = None, device: str | torch.device = "cpu") -> dict[str, Any]:
    """Command line, versions, commit (in a checkout), hardware and seed of this process, as plain values."""
    return {
        "command": command_line(),
        "pcnclaws": __version__,
        "commit": commit(),
        "python": platform.python_version(),
        "torch": torch.__version__,
        "numpy": np.__version__,
        "system": platform.system(),
        "processor": processor(),
        "instructions": torch.backends.cpu.get_cpu_capability(),  # as AVX2
        "cores": os.cpu_count(),
        "threads": torch.get_num_threads(),
        "device": torch.cuda.get_device_name(device) if torch.device(device).type == "cuda" else "cpu",
        "seed": seed,
    }


def command_line() -> str:
    """The command that started this process, with 'python' for the interpreter's path."""
    return shlex.join(["python", *sys.orig_argv[1:]])


@cache
def commit() -> str | None:
    """Hash of the commit of the checkout that runs, '+' behind it when files differ from it; None outside of one.

    Read once: a long command calls it as it begins, since the checkout may move on while it runs.
    """
    git = shutil.which("git")
    if git is None or not (REPOSITORY / ".git").exists():
        return None
    head = _output(git, "rev-parse", "HEAD")
    changed = _output(git, "status", "--porcelain", "--untracked-files=no")
    return f"{head}+" if head and changed else head or None


def processor() -> str:
    """Name of the CPU."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def _output(git: str, *arguments: str) -> str:
    """What git prints; empty when it fails."""
    try:
        # a fixed program with fixed arguments, no shell
        done = subprocess.run(  # noqa: S603
            [git, "-C", str(REPOSITORY), *arguments], capture_output=True, text=True, timeout=10, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""
