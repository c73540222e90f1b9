"""The wheel brings its configuration along."""

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.mark.slow
def test_a_command_runs_from_the_wheel_alone(tmp_path):
    build = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(tmp_path), str(ROOT)]
    subprocess.run(build, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
        shipped = {
            f"pcnclaws/conf/{path.relative_to(ROOT / 'conf').as_posix()}" for path in ROOT.glob("conf/**/*.yaml")
        }
        # benchmarks run from a checkout
        of_benchmarks = {name for name in shipped if "/conf/problem/" in name or name.endswith("/benchmark.yaml")}
        assert shipped - of_benchmarks <= names
        assert not of_benchmarks & names
        archive.extractall(tmp_path / "installed")
    code = "import pcnclaws, sys; print(pcnclaws.__file__); from pcnclaws.simulate import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code, "law=analytic", "simulation.steps=5", "scene.particles_per_edge=4", "output=x.h5"],
        cwd=tmp_path / "installed",
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(str(tmp_path / "installed"))
    assert (tmp_path / "installed" / "x.h5").is_file()
