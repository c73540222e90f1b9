"""Compiles the C++ kernels once for this machine, keeps them, and loads them."""

import ctypes
import hashlib
import logging
import os
import platform
import shlex
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import cache
from pathlib import Path

import torch
from filelock import FileLock

log = logging.getLogger(__name__)

SOURCES = Path(__file__).parent / "source"
COMPILERS = ("g++", "c++", "clang++")
# Infinities and NaN keep their meaning: a diverged particle must be seen.
FLAGS = ("-std=c++17", "-O3", "-march=native", "-fno-math-errno", "-fno-trapping-math", "-fPIC", "-fvisibility=hidden")
# A library that lacks a function is refused when it is made and not when it is used.
LINK_FLAGS = ["-shared", *(["-Wl,-z,defs"] if platform.system() == "Linux" else [])]
SLOWER = "simulations run in PyTorch, several times slower"
LONGEST_COMPILATION = 600.0  # seconds
NUMBERS = {"float32": "float", "float64": "double"}
LAW_HEADER = "law.hpp"
_law_libraries: list[ctypes.CDLL] = []


@cache
def kernel_library() -> ctypes.CDLL | None:
    """The kernels of the step, compiled now or in an earlier run; None, and one line, where they cannot be."""
    return _library("kernels.cpp", {})


@cache
def law_library(text: str) -> ctypes.CDLL | None:
    """The kernels of a law, from the text of its law.hpp; None, and one line, where they cannot be made."""
    library = _library("law_kernels.cpp", {LAW_HEADER: text})
    if library is not None:
        _law_libraries.append(library)
    return library


@cache
def stretch_law_library() -> ctypes.CDLL | None:
    """The kernels of laws of the right stretch; None, and one line, where they cannot be compiled."""
    return _library("stretch_law_kernels.cpp", {})


def fallbacks() -> int:
    """How many particles found their principal axes by the slow path on the CPU in this process."""
    return sum(ctypes.c_int64.in_dll(library, "fallbacks").value for library in _law_libraries)


def _library(main: str, headers: Mapping[str, str]) -> ctypes.CDLL | None:
    compiler = find_compiler()
    if compiler is None:
        _warn_of_no_compiler()
        return None
    try:
        return _load(_library_file(compiler, main, headers))
    except (OSError, RuntimeError, subprocess.SubprocessError) as error:
        log.warning("the C++ kernels could not be made with '%s' (%s): %s", " ".join(compiler), _reason(error), SLOWER)
        return None


@cache
def _warn_of_no_compiler() -> None:
    log.warning("no C++ compiler was found (g++, c++, clang++ or $CXX): %s", SLOWER)


@cache
def find_compiler() -> tuple[str, ...] | None:
    """The command of the C++ compiler: that of the environment variable CXX, or the first known one installed."""
    named = tuple(shlex.split(os.environ.get("CXX", "")))
    if named and shutil.which(named[0]):
        return named
    if named:
        log.warning("the C++ compiler CXX=%s was not found: looking for others", " ".join(named))
    return next(((path,) for name in COMPILERS if (path := shutil.which(name))), None)


def cache_folder() -> Path:
    """Where compiled kernels are kept: $XDG_CACHE_HOME/pcnclaws, by default ~/.cache/pcnclaws."""
    root = os.environ.get("XDG_CACHE_HOME")
    return (Path(root) if root else Path.home() / ".cache") / "pcnclaws"


def _load(library: Path) -> ctypes.CDLL:
    try:
        return ctypes.CDLL(str(library))
    except OSError:
        library.unlink(missing_ok=True)  # damaged: the next process compiles it anew
        raise


def _reason(error: Exception) -> str:
    """The line of an error that says what is wrong."""
    lines = (getattr(error, "stderr", "") or str(error)).strip().splitlines()
    return next((line for line in lines if "error" in line), lines[0] if lines else type(error).__name__)


def _library_file(compiler: Sequence[str], main: str, made: Mapping[str, str]) -> Path:
    """The library for these sources, compiler and processor; compiled if it is not there yet.

    made  headers that are not among the sources, by name
    """
    sources = {file.name: file.read_text() for file in (*sorted(SOURCES.glob("*.hpp")), SOURCES / main)} | dict(made)
    version = _run([*compiler, "--version"])
    parts = (version, *compiler, *FLAGS, *LINK_FLAGS, _openmp_library() or "", _processor())
    key = hashlib.sha256("\n".join(parts).encode())
    for text in sources.values():
        key.update(text.encode())
    folder = writable(cache_folder())
    library = folder / f"{Path(main).stem}-{key.hexdigest()[:20]}.so"
    if library.exists():  # no need to wait for a process that compiles other sources
        return library
    with FileLock(folder / "kernels.lock"):
        if not library.exists():
            with tempfile.TemporaryDirectory(dir=folder) as work:
                for name, text in sources.items():
                    (Path(work) / name).write_text(text)
                _compile(compiler, Path(work) / main).replace(library)
    return library


@cache
def _tell() -> None:
    """One line in each process that compiles."""
    log.warning(
        "compiling C++ kernels for this machine: once, some ten seconds (simulation.backend=torch goes without)"
    )


def _compile(compiler: Sequence[str], main: Path) -> Path:
    _tell()
    start, openmp = time.monotonic(), _openmp_library()
    try:
        library = _linked(compiler, main, openmp)
    except subprocess.CalledProcessError:
        if openmp is None:
            raise
        library = _linked(compiler, main, None)  # a compiler without this OpenMP: kernels of one thread
    log.info("compiled the C++ kernels in %.0f s", time.monotonic() - start)
    return library


def _linked(compiler: Sequence[str], main: Path, openmp: str | None) -> Path:
    """The library, with the kernels of each precision compiled at the same time.

    openmp  PyTorch's own OpenMP library: a second one would start threads of its own, in each other's way
    """

    work = main.parent
    objects = [str(work / f"{precision}.o") for precision in NUMBERS]
    common = [*compiler, *FLAGS, *(["-fopenmp"] if openmp else []), "-c", str(main)]
    _run(
        *(
            [*common, f"-DPRECISION={precision}", f"-DNUMBER={number}", "-o", target]
            for (precision, number), target in zip(NUMBERS.items(), objects, strict=True)
        )
    )
    library = work / "kernels.so"
    _run([*compiler, *LINK_FLAGS, *objects, *([openmp] if openmp else []), "-o", str(library)])
    return library


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


@cache
def _temporary() -> tempfile.TemporaryDirectory[str]:
    """A folder that is gone when the process ends."""
    return tempfile.TemporaryDirectory(prefix="pcnclaws-")


def writable(folder: Path) -> Path:
    """The folder, made if need be; a temporary one for this process where it cannot be written or is another user's."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if os.access(folder, os.W_OK) and folder.stat().st_uid == os.getuid():
            return folder
    except OSError:
        pass
    log.warning("the folder %s cannot be used: compiled kernels are not kept for later processes", folder)
    return Path(_temporary().name)


def _run(*commands: Sequence[str]) -> str:
    """What the first command prints; all of them run at the same time, and none outlives an interruption."""
    with ExitStack() as stack:
        processes = [stack.enter_context(_started(command)) for command in commands]
        said = [process.communicate(timeout=LONGEST_COMPILATION) for process in processes]
    for process, (out, err) in zip(processes, said, strict=True):
        if process.returncode:
            raise subprocess.CalledProcessError(process.returncode, process.args, out, err)
    return said[0][0]


@contextmanager
def _started(command: Sequence[str]) -> Iterator[subprocess.Popen[str]]:
    """A process that is killed, with those that it started, where the block ends before it."""
    # a compiler that the user has installed, with arguments of ours and no shell
    with subprocess.Popen(  # noqa: S603
        list(command), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        try:
            yield process
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
