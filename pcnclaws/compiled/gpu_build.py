"""Compiles kernels for the GPU at hand with NVRTC, which comes with PyTorch, keeps them, loads them and starts them."""

import ctypes
import functools
import hashlib
import logging
import subprocess
import tempfile
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import torch

from pcnclaws.compiled.build import LAW_HEADER, LINK_FLAGS, SOURCES, cache_folder, find_compiler, writable
from pcnclaws.compiled.law_source import LawKernel

log = logging.getLogger(__name__)

OPTIONS = ("-std=c++17", "-default-device", "-DONE_LANE", "--diag-suppress=170")
HOST_FLAGS = ("-std=c++17", "-O1", "-fPIC", "-fvisibility=hidden", "-DONE_LANE", "-Wno-unknown-pragmas")
# Threads of a block: few where there are few particles, so that all processors of the GPU take part.
BLOCK, SMALL_BLOCK, SMALL = 128, 32, 50_000
Macros = tuple[tuple[str, str], ...]


class Kernels(ABC):
    """The kernels of one source file."""

    @abstractmethod
    def start(self, name: str, threads: int, *arguments: Any, shared: int = 0) -> None:
        """Runs a kernel in at least so many threads.

        arguments  ctypes values and structures
        shared     memory that the threads of a block share [bytes]
        """

    @abstractmethod
    def counter(self, name: str) -> int:
        """The value of a 64-bit counter of the source. Waits for the GPU."""


@cache
def gpu_serves() -> bool:
    """Whether kernels can be compiled for the GPU here; if not, one line of warning."""
    try:
        kernels_of("gpu_step.cu", torch.device("cuda"), NUMBER="float")
    except (OSError, RuntimeError) as error:
        log.warning("kernels cannot be compiled for this GPU (%s): steps run in PyTorch, several times slower", error)
        return False
    return True


def kernels_of(source: str, device: torch.device, law: LawKernel | None = None, **macros: object) -> Kernels:
    """The kernels of a source file, compiled now or in an earlier run.

    device  a GPU; or the CPU, where the threads run one after the other, to test the same source without a GPU
    law     the law that the source is compiled with
    macros  what is defined for the source
    raises  RuntimeError when they cannot be compiled
    """
    defined = tuple((name, str(value)) for name, value in macros.items())
    if device.type == "cpu":
        return _host_kernels(source, law, defined)
    number = torch.cuda.current_device() if device.index is None else device.index
    return _gpu_kernels(source, law, defined, number)


class _GpuKernels(Kernels):
    def __init__(self, binary: bytes, device: int) -> None:
        self._device, self._functions = device, dict[str, ctypes.c_void_p]()
        self._module = ctypes.c_void_p()
        with _context_of(device):
            _require(_driver().cuModuleLoadData(ctypes.byref(self._module), binary))

    def start(self, name: str, threads: int, *arguments: Any, shared: int = 0) -> None:
        if not threads:
            return
        block = BLOCK if threads > SMALL else SMALL_BLOCK
        pointers = (ctypes.c_void_p * len(arguments))(*(ctypes.addressof(argument) for argument in arguments))
        with _context_of(self._device):
            stream = ctypes.c_void_p(torch.cuda.current_stream().cuda_stream)
            grid, shape = (-(-threads // block), 1, 1), (block, 1, 1)
            _require(_driver().cuLaunchKernel(self._function(name), *grid, *shape, shared, stream, pointers, None))

    def counter(self, name: str) -> int:
        place, size, value = ctypes.c_void_p(), ctypes.c_size_t(), ctypes.c_int64()
        with _context_of(self._device):
            found = _driver().cuModuleGetGlobal_v2(ctypes.byref(place), ctypes.byref(size), self._module, name.encode())
            _require(found)
            torch.cuda.synchronize()
            _require(_driver().cuMemcpyDtoH_v2(ctypes.byref(value), place, size))
        return value.value

    def _function(self, name: str) -> ctypes.c_void_p:
        if name not in self._functions:
            function = ctypes.c_void_p()
            _require(_driver().cuModuleGetFunction(ctypes.byref(function), self._module, name.encode()))
            self._functions[name] = function
        return self._functions[name]


class _HostKernels(Kernels):
    def __init__(self, library: Path) -> None:
        self._library = ctypes.CDLL(str(library))
        self._thread = ctypes.c_int64.in_dll(self._library, "thread")

    def start(self, name: str, threads: int, *arguments: Any, shared: int = 0) -> None:
        function = getattr(self._library, name)
        for number in range(threads):
            self._thread.value = number
            function(*arguments)

    def counter(self, name: str) -> int:
        return ctypes.c_int64.in_dll(self._library, name).value


@functools.cache
def _gpu_kernels(source: str, law: LawKernel | None, macros: Macros, device: int) -> Kernels:
    major, minor = torch.cuda.get_device_capability(device)
    options = [*OPTIONS, f"--gpu-architecture=sm_{major}{minor}", *(f"-D{name}={value}" for name, value in macros)]
    headers = {file.name: file.read_bytes() for file in sorted(SOURCES.glob("*.hpp"))}
    if law is not None:
        headers[LAW_HEADER] = law.text.encode()
    main = (SOURCES / source).read_bytes()
    key = hashlib.sha256("\n".join((_nvrtc_version(), *options)).encode() + main + b"".join(headers.values()))
    kept = writable(cache_folder()) / f"{Path(source).stem}-{key.hexdigest()[:20]}.cubin"
    try:
        return _GpuKernels(kept.read_bytes(), device)
    except (FileNotFoundError, RuntimeError):  # not there yet, or damaged
        what = law.name if law is not None else "the step"
        log.warning("compiling %s for this GPU: once, a few seconds (simulation.backend=torch goes without)", what)
        with tempfile.TemporaryDirectory(dir=kept.parent) as folder:
            whole = Path(folder) / kept.name
            whole.write_bytes(_compiled(source, main, headers, options))
            whole.replace(kept)
        return _GpuKernels(kept.read_bytes(), device)


@functools.cache
def _host_kernels(source: str, law: LawKernel | None, macros: Macros) -> Kernels:
    compiler = find_compiler()
    if compiler is None:
        raise RuntimeError("no C++ compiler was found")
    definitions = [f"-D{name}={value}" for name, value in macros]
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder) / "kernels.so"
        if law is not None:
            (Path(folder) / LAW_HEADER).write_text(law.text)
        included = ["-I", folder, "-I", str(SOURCES)]
        command = [*compiler, *HOST_FLAGS, *definitions, *LINK_FLAGS, *included, "-x", "c++", str(SOURCES / source)]
        # a compiler that the user has installed, with arguments of ours and no shell
        done = subprocess.run([*command, "-o", str(library)], capture_output=True, text=True, check=False)  # noqa: S603
        if done.returncode:
            raise RuntimeError(f"{source} cannot be compiled: {done.stderr.strip()}")
        return _HostKernels(library)


def _compiled(source: str, main: bytes, headers: Mapping[str, bytes], options: list[str]) -> bytes:
    """The machine code of a source file."""
    nvrtc, program = _nvrtc(), ctypes.c_void_p()
    names = [name.encode() for name in headers]
    texts = (ctypes.c_char_p * len(names))(*headers.values())
    included = (ctypes.c_char_p * len(names))(*names)
    arguments = (ctypes.c_char_p * len(options))(*(option.encode() for option in options))
    created = nvrtc.nvrtcCreateProgram(ctypes.byref(program), main, source.encode(), len(names), texts, included)
    if created:
        raise RuntimeError(f"NVRTC refuses {source} (error {created})")
    try:
        failed = nvrtc.nvrtcCompileProgram(program, len(options), arguments)
        if failed:
            raise RuntimeError(f"{source} cannot be compiled for this GPU: {_text(nvrtc, program).strip()}")
        return _output(nvrtc.nvrtcGetCUBINSize, nvrtc.nvrtcGetCUBIN, program)
    finally:
        nvrtc.nvrtcDestroyProgram(ctypes.byref(program))


def _text(nvrtc: ctypes.CDLL, program: ctypes.c_void_p) -> str:
    """What the compiler says."""
    return _output(nvrtc.nvrtcGetProgramLogSize, nvrtc.nvrtcGetProgramLog, program).rstrip(b"\0").decode()


def _output(size_of: Any, read: Any, program: ctypes.c_void_p) -> bytes:
    size = ctypes.c_size_t()
    size_of(program, ctypes.byref(size))
    found = ctypes.create_string_buffer(size.value)
    read(program, found)
    return found.raw


@cache
def _nvrtc() -> ctypes.CDLL:
    """The compiler, as PyTorch brings it; OSError where there is none."""
    name = f"libnvrtc.so.{(torch.version.cuda or '').split('.')[0]}"
    beside = sorted((Path(torch.__file__).parent.parent / "nvidia").glob(f"*/lib/{name}"))
    for library in beside:
        for builtins in library.parent.glob("libnvrtc-builtins.so.*"):
            ctypes.CDLL(str(builtins))  # the compiler asks for it by its name alone
    return ctypes.CDLL(str(beside[0]) if beside else name)


@cache
def _driver() -> ctypes.CDLL:
    return ctypes.CDLL("libcuda.so.1")


@contextmanager
def _context_of(device: int) -> Iterator[None]:
    """Makes the context current that PyTorch uses, in a thread of its own (a backward pass) that has none yet, too."""
    with torch.cuda.device(device):
        context = ctypes.c_void_p()
        _require(_driver().cuCtxGetCurrent(ctypes.byref(context)))
        if not context:
            _require(_driver().cuDevicePrimaryCtxRetain(ctypes.byref(context), device))
            _require(_driver().cuCtxSetCurrent(context))
        yield


def _nvrtc_version() -> str:
    major, minor = ctypes.c_int(), ctypes.c_int()
    _nvrtc().nvrtcVersion(ctypes.byref(major), ctypes.byref(minor))
    return f"NVRTC {major.value}.{minor.value}"


def _require(status: int) -> None:
    if status:
        message = ctypes.c_char_p()
        _driver().cuGetErrorString(status, ctypes.byref(message))
        raise RuntimeError(f"CUDA: {(message.value or b'unknown error').decode()}")
