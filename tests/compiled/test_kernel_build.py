"""How the kernels come to be: without a compiler, compiled once, kept, and made anew when damaged."""

import ctypes
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from conftest import Outcome
from filelock import FileLock

from pcnclaws.compiled.build import _library_file, cache_folder, find_compiler


@pytest.mark.slow
def test_without_a_compiler_one_line_says_that_pytorch_runs(
    command: Callable[..., Outcome], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CXX", raising=False)
    options = ("material=elasticity", "simulation.steps=2", "simulation.every=2", "scene.particles_per_edge=3")
    options = (*options, "scene.side=0.15")
    done = command("simulate", *options, "picture=false", "output=x.h5")
    assert done.status == 0
    assert done.err.count("\n") == 1
    assert "no C++ compiler" in done.err
    refused = command("simulate", *options, "picture=false", "output=y.h5", "simulation.backend=compiled")
    assert refused.status == 2
    assert "simulation.backend=compiled" in refused.err.splitlines()[-1]
    assert not (tmp_path / "y.h5").exists()


@pytest.mark.slow
@pytest.mark.skipif(find_compiler() is None, reason="needs a C++ compiler")
def test_compiled_once_and_kept(
    command: Callable[..., Outcome], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "a cache"))
    options = ("material=elasticity", "simulation.steps=2", "simulation.every=2", "scene.particles_per_edge=3")
    options = (*options, "scene.side=0.15", "picture=false", "output=x.h5", "simulation.skip=none")
    first = command("simulate", *options)
    assert "compiling C++ kernels" in first.err
    assert first.status == 0
    again = command("simulate", *options)
    assert again.err == ""
    # a library that was damaged is made anew by the next process
    (library,) = (tmp_path / "a cache" / "pcnclaws").glob("kernels-*.so")
    library.write_bytes(b"")
    damaged = command("simulate", *options)
    assert damaged.status == 0
    assert "could not be made" in damaged.err or "compiling" in damaged.err
    assert "compiling C++ kernels" in command("simulate", *options).err


@pytest.mark.slow
@pytest.mark.skipif(find_compiler() is None, reason="needs a C++ compiler")
def test_two_jobs_that_begin_with_one_empty_cache_compile_once_and_end_alike(tmp_path: Path) -> None:
    options = ("material=elasticity", "simulation.steps=40", "simulation.every=20", "scene.particles_per_edge=3")
    options = (*options, "scene.side=0.15", "scene.velocity=[0,-2,0]", "picture=false", "threads=1")
    jobs = [
        subprocess.Popen(
            [sys.executable, "-m", "pcnclaws.simulate", *options, f"output={name}.h5"],
            cwd=tmp_path,
            env={**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache")},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        for name in "ab"
    ]
    said = [job.communicate(timeout=600)[1] for job in jobs]
    assert [job.returncode for job in jobs] == [0, 0], said
    assert "could not be made" not in "".join(said)
    first, second = ((tmp_path / f"{name}.h5").read_bytes() for name in "ab")
    assert first == second
    kept = sorted(path.name for path in (tmp_path / "cache" / "pcnclaws").iterdir())
    libraries = [name for name in kept if name.endswith(".so")]
    assert sum(name.startswith("kernels-") for name in libraries) == 1
    assert set(kept) - set(libraries) <= {"kernels.lock"}
    for name in libraries:
        ctypes.CDLL(str(tmp_path / "cache" / "pcnclaws" / name))  # whole


@pytest.mark.skipif(find_compiler() is None, reason="needs a C++ compiler")
def test_kernels_that_are_there_do_not_wait_for_a_process_that_compiles_others(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    compiler = find_compiler() or ()
    kept = _library_file(compiler, "kernels.cpp", {})
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    cache_folder().mkdir(mode=0o700)
    shutil.copy(kept, cache_folder())
    with FileLock(cache_folder() / "kernels.lock"):
        assert _library_file(compiler, "kernels.cpp", {}) == cache_folder() / kept.name
