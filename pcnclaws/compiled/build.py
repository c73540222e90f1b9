"""Compiles the C++ kernels once for this machine, keeps them, and loads them."""

import ctypes
import hashlib
import logging
import os
import platform
import shutil
import subprocess
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path

import torch
from filelock import FileLock

log = logging.getLogger(__name__)

SOURCES = Path(__file__).parent / "source"
COMPILERS = ("g++", "c++", "clang++")
# Infinities and NaN keep their meaning: a diverged particle must be seen.
FLAGS = ("-std=c++17", "-O3", "-march=native", "-fno-math-errno", "-fno-trapping-math", "-fPIC", "-w")
SLOWER = "simulations run in PyTorch, several times slower"
LONGEST_COMPILATION = 600.0  # seconds
NUMBERS = {"float32": "float", "float64": "double"}


@cache
def kernel_library() -> ctypes.CDLL | None:
    """The kernels, compiled now or in an earlier run; None, with one line of warning, where they cannot be."""
    compiler = find_compiler()
    if compiler is None:
        log.warning("no C++ compiler was found (g++, c++, clang++ or $CXX): %s", SLOWER)
        return None
    try:
        return ctypes.CDLL(str(_library_file(compiler)))
    except (OSError, subprocess.SubprocessError) as error:
        reason = (getattr(error, "stderr", "") or str(error)).strip().splitlines()
        shown = reason[0] if reason else type(error).__name__
        log.warning("the C++ kernels could not be compiled with %s (%s): %s", compiler, shown, SLOWER)
        return None


def find_compiler() -> str | None:
    """The C++ compiler of the environment variable CXX, or the first known one that is installed."""
    named = os.environ.get("CXX")
    return next((path for name in ([named] if named else COMPILERS) if (path := shutil.which(name))), None)


def cache_folder() -> Path:
    """Where compiled kernels are kept: $XDG_CACHE_HOME/pcnclaws, by default ~/.cache/pcnclaws."""
    root = os.environ.get("XDG_CACHE_HOME")
    return (Path(root) if root else Path.home() / ".cache") / "pcnclaws"


def _library_file(compiler: str) -> Path:
    """The library for these sources, compiler and processor; compiled if it is not there yet."""
    sources = sorted(SOURCES.iterdir())
    version = _run([compiler, "--version"])
    key = hashlib.sha256("\n".join((version, *FLAGS, _openmp_library() or "", _processor())).encode())
    for source in sources:
        key.update(source.read_bytes())
    folder = _writable(cache_folder())
    library = folder / f"kernels-{key.hexdigest()[:20]}.so"
    with FileLock(folder / "kernels.lock"):
        if not library.exists():
            with tempfile.TemporaryDirectory(dir=folder) as work:
                for source in sources:
                    (Path(work) / source.name).write_bytes(source.read_bytes())
                _compile(compiler, Path(work)).replace(library)
    return library


def _compile(compiler: str, work: Path) -> Path:
    log.warning(
        "compiling the C++ kernels for this machine: once, about half a minute (simulation.backend=torch goes without)"
    )
    start = time.monotonic()
    openmp = _openmp_library()
    try:
        objects = _objects(compiler, work, ["-fopenmp"] if openmp else [])
    except subprocess.CalledProcessError:
        if not openmp:
            raise
        # a compiler without OpenMP: kernels of one thread
        openmp, objects = None, _objects(compiler, work, [])
    library = work / "kernels.so"
    # PyTorch's own OpenMP library: a second one would start threads of its own, which wait in each other's way
    _run([compiler, "-shared", *objects, *([openmp] if openmp else []), "-o", str(library)])
    log.info("compiled the C++ kernels in %.0f s", time.monotonic() - start)
    return library


def _objects(compiler: str, work: Path, more_flags: Sequence[str]) -> list[str]:
    """The kernels of each precision, compiled at the same time."""

    def compiled(precision: str, number: str) -> str:
        target = str(work / f"{precision}.o")
        defined = [f"-DPRECISION={precision}", f"-DNUMBER={number}"]
        _run([compiler, *FLAGS, *more_flags, *defined, "-c", str(work / "kernels.cpp"), "-o", target])
        return target

    with ThreadPoolExecutor() as pool:
        return list(pool.map(compiled, NUMBERS.keys(), NUMBERS.values()))


def _openmp_library() -> str | None:
    """The OpenMP library (GNU) that PyTorch has loaded into this process, None where it has none."""
    torch_root = Path(torch.__file__).parent
    for folder in (torch_root / "lib", torch_root.parent / "torch.libs"):
        for candidate in sorted(folder.glob("libgomp*.so*")):
            return str(candidate)
    return None


def _processor() -> str:
    """What -march=native depends on."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    flags = next((line for line in lines if line.startswith(("flags", "Features"))), "")
    return f"{platform.machine()} {platform.processor()} {flags}"


def _writable(folder: Path) -> Path:
    """The folder, made if need be; a temporary one for this process where it cannot be written."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if os.access(folder, os.W_OK):
            return folder
    except OSError:
        pass
    return Path(tempfile.mkdtemp(prefix="pcnclaws-"))


def _run(command: Sequence[str]) -> str:
    # a compiler that the user has installed, with arguments of ours and no shell
    done = subprocess.run(  # noqa: S603
        list(command), capture_output=True, text=True, timeout=LONGEST_COMPILATION, check=True
    )
    return done.stdout
