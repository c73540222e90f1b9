"""Peak memory of a piece of work, measured in a process of its own.

python -m benchmarks.processes '{"case": {"material": "sand"}, "work": "forward", "steps": 2, ...}'
"""

import json
import os
import subprocess
import sys
import time
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch

from benchmarks.cases import Case, Prepared
from benchmarks.skip_trials import run_trial, switched_off
from pcnclaws.compiled.backend import use_backend
from pcnclaws.simulation.fast_paths import Skips

STATUS = Path("/proc/self/status")
MEGABYTE = 1e6


def peak_memory(case: Case, work: str, steps: int, backend: str) -> dict[str, float] | None:
    """Peak resident memory of `steps` steps on the CPU, with the present number of threads.

    work     'forward' or 'gradient', the method of Prepared
    returns  {"library_mb": after the imports, "peak_mb": in all, "above_mb": the difference}, in 10^6 bytes;
             None where the system does not tell (only Linux does) or the process was killed
    """
    return _memory(_of_process({"case": asdict(case), "work": work, "steps": steps, "backend": backend}))


def seconds_of_process(case: Case, work: str, steps: int, backend: str, cache: str) -> float:
    """Seconds from the end of the imports to the end of the work, compiled kernels being kept in the folder `cache`."""
    order = {"case": asdict(case), "work": work, "steps": steps, "backend": backend}
    return _of_process(order, {"XDG_CACHE_HOME": cache})["seconds"]


def peak_memory_of_trial(name: str, switch: str, edge: int, steps: int, backend: str) -> dict[str, float] | None:
    """The same for a trial of skip_trials.

    switch  'on' or 'off'
    """
    return _memory(_of_process({"trial": name, "switch": switch, "edge": edge, "steps": steps, "backend": backend}))


def _memory(found: dict[str, float]) -> dict[str, float] | None:
    """The memory of what a process found."""
    return {name: value for name, value in found.items() if name.endswith("_mb")} or None


def _of_process(order: dict[str, Any], environment: Mapping[str, str] | None = None) -> dict[str, float]:
    """What a process of its own finds; nothing when the system killed it, for lack of memory."""
    text = json.dumps(order | {"threads": torch.get_num_threads()})
    # our own module with our own argument, no shell
    done = subprocess.run(  # noqa: S603
        [sys.executable, "-m", __name__, text],
        env={**os.environ, **(environment or {})},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode > 0:
        raise RuntimeError(f"{text} cannot be measured: {done.stderr.strip()}")
    return json.loads(done.stdout.splitlines()[-1]) if done.returncode == 0 else {}


def _measured(order: dict[str, Any]) -> dict[str, float]:
    torch.set_num_threads(order["threads"])
    use_backend(order["backend"])
    began, library = time.monotonic(), _highest_mb()
    if "trial" in order:
        skips = Skips() if order["switch"] == "on" else switched_off(order["trial"])
        run_trial(order["trial"], skips, order["edge"], order["steps"])
    else:
        prepared = Prepared(Case(**order["case"]), torch.device("cpu"), settle=0)
        getattr(prepared, order["work"])(order["steps"])()
    seconds, peak = time.monotonic() - began, _highest_mb()
    memory = {"library_mb": library, "peak_mb": peak, "above_mb": peak - library} if library and peak else {}
    return {"seconds": seconds, **memory}


def _highest_mb() -> float:
    """The most memory that this process has held; 0 where the system does not tell.

    Not ru_maxrss: a new process takes over that of the process which started it.
    """
    return int(STATUS.read_text().split("VmHWM:")[1].split()[0]) * 1024 / MEGABYTE if STATUS.exists() else 0.0


if __name__ == "__main__":
    print(json.dumps(_measured(json.loads(sys.argv[1]))))
