"""How the kernels come to be: without a compiler, compiled once, kept, and made anew when damaged."""

import shutil
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
