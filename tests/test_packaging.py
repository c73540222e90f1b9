"""What is built brings along all that the commands need, and asks for nothing that they do not."""

import ast
import os
import re
import subprocess
import sys
import tarfile
import tomllib
import venv
import zipfile
from collections.abc import Callable, Iterator
from importlib.metadata import packages_distributions
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from pcnclaws.errors import not_installed

ROOT = Path(__file__).parents[1]
PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
# Which versions are installed with the wheel: `make test-lowest` asks for the lowest.
VERSIONS = ROOT / os.environ.get("VERSIONS", "requirements.lock")
# Loaded by other packages: Lightning writes TensorBoard's files.
NAMED_ALONE = {"tensorboard"}


def distribution(requirement: str) -> str:
    return re.split(r"[\[<>=!~;, ]", requirement, maxsplit=1)[0].lower()


def imported() -> set[str]:
    """The packages of others that an import statement of ours names."""
    names: set[str] = set()
    for path in (ROOT / "pcnclaws").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                names |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                names.add(node.module)
    return {name.partition(".")[0] for name in names} - set(sys.stdlib_module_names) - {"pcnclaws"}


def test_what_is_imported_is_asked_for_and_nothing_else() -> None:
    of_module = packages_distributions()
    needed = {of_module[name][0].lower() for name in imported()} | NAMED_ALONE
    (mesh,) = PROJECT["optional-dependencies"]["mesh"]
    assert needed - {distribution(mesh)} == {distribution(line) for line in PROJECT["dependencies"]}


def test_the_lowest_versions_are_those_that_are_accepted() -> None:
    lines = (ROOT / "requirements.lowest").read_text(encoding="utf-8").splitlines()
    lowest = dict(line.split("==") for line in lines if "==" in line)
    accepted = {distribution(line): re.split(r">=|,", line)[1] for line in PROJECT["dependencies"]}
    found = {name: lowest[name].split(".") for name in accepted}
    assert {
        name: version.split(".") + ["0"] * (len(found[name]) - version.count(".") - 1)
        for name, version in accepted.items()
    } == found


def refusals() -> Iterator[tuple[str, str]]:
    """The package and the extra of each call of `not_installed`."""
    for path in (ROOT / "pcnclaws").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and ast.unparse(node.func) == not_installed.__name__:
                package, extra = (one.value for one in node.args[1:3] if isinstance(one, ast.Constant))
                yield str(package), str(extra)


def test_the_extra_that_a_refusal_names_brings_the_package() -> None:
    extras = PROJECT["optional-dependencies"]
    named = dict(refusals())
    brought = {extra: {package for package, one in named.items() if one == extra} for extra in named.values()}
    assert {extra: {distribution(line) for line in extras[extra]} for extra in brought} == brought
    assert len(brought) == 10


class Installed(NamedTuple):
    """An environment that holds the package as a user installs it, and a folder outside of the checkout."""

    programs: Path
    folder: Path

    def run(self, *arguments: str) -> "subprocess.CompletedProcess[str]":
        clean = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
        return subprocess.run(arguments, cwd=self.folder, env=clean, capture_output=True, text=True)

    def pip(self, *arguments: str) -> None:
        done = self.run(str(self.programs / "python"), "-m", "pip", "install", "--quiet", "--no-compile", *arguments)
        assert done.returncode == 0, done.stderr

    def command(self, *arguments: str) -> str:
        done = self.run(str(self.programs / "pcnclaws"), *arguments)
        assert done.returncode == 0, done.stderr
        return done.stdout

    def refused(self, *arguments: str) -> str:
        done = self.run(str(self.programs / "pcnclaws"), *arguments)
        assert done.returncode == 2, done.stderr
        (line,) = done.stderr.splitlines()
        return line


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The source distribution, and the wheel that is built from it."""
    folder = tmp_path_factory.mktemp("dist")
    build = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(folder), str(ROOT)]
    subprocess.run(build, check=True, capture_output=True)
    return {"sdist": next(folder.glob("*.tar.gz")), "wheel": next(folder.glob("*.whl"))}


@pytest.fixture(scope="module")
def installed(built: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Installed:
    """The wheel with what it asks for, in the versions of VERSIONS, and no extra."""
    folder = tmp_path_factory.mktemp("installed")
    venv.create(folder / "environment", with_pip=True)
    work = folder / "work"
    work.mkdir()
    environment = Installed(folder / "environment" / "bin", work)
    environment.pip("--constraint", str(VERSIONS), str(built["wheel"]))
    return environment


@pytest.mark.slow
def test_wheel_and_source_hold_what_they_should(built: dict[str, Path]) -> None:
    def files(folder: str, pattern: str = "**/*") -> set[str]:
        found = (ROOT / folder).glob(pattern)
        return {str(path.relative_to(ROOT)) for path in found if path.is_file() and "__pycache__" not in path.parts}

    with zipfile.ZipFile(built["wheel"]) as archive:
        in_wheel = {name for name in archive.namelist() if ".dist-info/" not in name}
    # benchmarks run from a checkout
    of_benchmarks = {"conf/benchmark.yaml", *files("conf/problem")}
    assert in_wheel == files("pcnclaws") | files("hydra_plugins") | {
        f"pcnclaws/{name}" for name in files("conf") - of_benchmarks
    }
    for needed in ("conf/train.yaml", "pretrained/sand/weights.safetensors", "compiled/source/kernels.cpp", "py.typed"):
        assert f"pcnclaws/{needed}" in in_wheel
    with tarfile.open(built["sdist"]) as archive:
        in_source = {name.partition("/")[2] for name in archive.getnames()}
    assert (
        files("pcnclaws")
        | files("hydra_plugins")
        | files("conf")
        | files("tests", "**/*.py")
        | files("benchmarks", "**/*.py")
        <= in_source
    )


@pytest.mark.slow
def test_the_wheel_asks_for_nothing_that_only_extras_need(installed: Installed) -> None:
    said = installed.run(str(installed.programs / "python"), "-m", "pip", "list", "--format=freeze")
    found = {line.partition("==")[0].lower() for line in said.stdout.splitlines()}
    assert "pcnclaws" in found
    assert not found & {
        "trimesh",
        "usd-core",
        "pyvista",
        "vtk",
        "imageio-ffmpeg",
        "wandb",
        "optuna",
        "emcee",
        "ezc3d",
        "joblib",
        "pytest",
        "beartype",
    }


@pytest.mark.slow
def test_every_command_runs_from_the_wheel(installed: Installed) -> None:
    still = ("material=elasticity", "picture=false")
    cube = ("scene.particles_per_edge=4", "scene.side=0.2", "scene.centre=[0.5,0.25,0.5]", "scene.velocity=[0,-3,0]")
    law = ("model.width=4", "threads=1", "training.iterations=2", "training.check_every=1")
    law = (*law, "training.segment_length.first=10", "training.segment_length.last=10", "training.batch_segments=1")
    data = ("data.folder=data", "data.train_scenes=2", "data.validation_scenes=1", "simulation.steps=20")
    run: Callable[..., str] = installed.command
    assert "simulate" in run("--help")
    assert run("--version").startswith("pcnclaws ")
    run("generate", "material=elasticity", *data, "scene.particles_per_edge=4")
    run("simulate", *still, *cube, "law=pretrained", "simulation.steps=60", "output=x.h5")
    run("train", *still, *law, "data.trajectories=x.h5", "output=run")
    run("evaluate", *still, "law=run", "trajectories=x.h5", "output=metrics.json")
    run("observe", "file=x.h5", "picture=false", "markers=0.2", "output=markers.csv")
    guess = ("initial_guess.youngs_modulus=1e5", "observation.file=x.h5", "screening=2", "output=estimate.json")
    run("estimate", *still, "law=analytic", *guess)
    run("calibrate", "material=elasticity", "law=run", "objects=2")
    run("render", "trajectory=x.h5", "output=x.png")
    run("export", "trajectory=x.h5", "output=x.csv")
    run("export", "law=run", "output=law.zip")
    run("export", "law=sand", "output=sand.hpp")
    made = {path.name for path in installed.folder.iterdir()}
    assert (installed.folder / "run" / "estimation.json").is_file()
    assert {"data", "x.h5", "run", "metrics.json", "markers.csv", "estimate.json", "x.png", "x.csv", "law.zip"} <= made
    where = installed.run(str(installed.programs / "python"), "-c", "import pcnclaws; print(pcnclaws.__file__)")
    assert where.stdout.startswith(str(installed.programs.parent))


@pytest.mark.slow
def test_what_needs_an_extra_says_which(installed: Installed) -> None:
    (installed.folder / "body.stl").write_text("solid body\nendsolid body\n")
    cube = np.stack(np.meshgrid(*3 * [np.linspace(0.4, 0.6, 3)]), -1).reshape(-1, 3)
    (installed.folder / "capture.c3d").write_bytes(b"")
    np.savez(installed.folder / "cube.npz", position=cube, velocity=0 * cube, volume=np.full(27, 1e-3))
    installed.command("simulate", "scene.particles=cube.npz", "simulation.steps=5", "picture=false", "output=y.h5")
    for extra, arguments in {
        "mesh": ("simulate", "scene.mesh=body.stl"),
        "video": ("render", "trajectory=y.h5", "output=y.mp4"),
        "pyvista": ("render", "trajectory=y.h5", "renderer=pyvista", "output=y.png"),
        "usd": ("export", "trajectory=y.h5", "output=y.usd"),
        "wandb": ("train", "logger=wandb"),
        "sample": ("estimate", "material=sand", "observation.file=y.h5", "uncertainty=sample"),
        "c3d": ("estimate", "material=sand", "observation.file=capture.c3d", "scene.shape=cube"),
        "sweep": ("train", "--multirun", "hydra/sweeper=search", "seed=1,2"),
    }.items():
        assert f"accepted: pip install 'pcnclaws[{extra}]', or " in installed.refused(*arguments)
    # and that command is one that pip takes, of the package that is there
    installed.pip("--constraint", str(VERSIONS), "pcnclaws[mesh]")
    assert "body.stl" in installed.refused("simulate", "scene.mesh=body.stl")


@pytest.mark.slow
def test_the_source_installs_what_the_wheel_does(built: dict[str, Path], installed: Installed) -> None:
    def files() -> set[str]:
        listed = installed.run(str(installed.programs / "python"), "-m", "pip", "show", "--files", "pcnclaws")
        lines = {line.strip() for line in listed.stdout.partition("Files:")[2].splitlines()}
        return {line for line in lines if ".dist-info" not in line and "__pycache__" not in line}

    before = files()
    installed.pip("--no-deps", "--force-reinstall", str(built["sdist"]))
    assert files() == before
    assert len(before) > 300
