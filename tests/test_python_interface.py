"""What `import pcnclaws as pc` offers: quickly, lazily, and as docs/python.md, the README and the examples say."""

import re
import runpy
import subprocess
import sys
import time
from importlib import import_module
from pathlib import Path

import pytest

import pcnclaws as pc

# of PyTorch's own forward mode
pytestmark = pytest.mark.filterwarnings("ignore:`torch.jit.script` is deprecated:DeprecationWarning")
ROOT = Path(__file__).parents[1]
EXAMPLES = sorted((ROOT / "examples").glob("[0-9]*.py"))


def blocks(page: str) -> list[str]:
    """The Python of a page, block by block."""
    return re.findall(r"^```python\n(.*?)^```", (ROOT / page).read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)


def test_importing_is_quick_and_loads_nothing_heavy():
    heavy = {"torch", "numpy", "hydra", "lightning"}
    code = f"import sys, pcnclaws; sys.exit(not {heavy}.isdisjoint(sys.modules))"
    times = []
    for _ in range(3):
        began = time.perf_counter()
        subprocess.run([sys.executable, "-c", code], check=True)
        times.append(time.perf_counter() - began)
    began = time.perf_counter()
    subprocess.run([sys.executable, "-c", "pass"], check=True)
    assert min(times) - (time.perf_counter() - began) < 0.3


def test_every_public_name_is_there_and_described():
    described = (ROOT / "docs/python.md").read_text(encoding="utf-8")
    assert set(pc.__all__) <= set(dir(pc))
    for name in pc.__all__:
        assert getattr(pc, name).__doc__, name
        assert f"pc.{name}" in described, name
    with pytest.raises(AttributeError, match="has no attribute 'Scnee'"):
        pc.Scnee  # noqa: B018  # pyright: ignore[reportAttributeAccessIssue]


def test_the_blocks_of_the_page_run_as_they_stand(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    exec(compile("\n".join(blocks("docs/python.md")), "docs/python.md", "exec"), {})  # noqa: S102  # our own page
    said = capsys.readouterr().out
    assert "did you mean 'friction_angle'" in said
    assert {"x.h5", "frames.pvd", "points_2.ply", "fall.png"} <= {path.name for path in tmp_path.iterdir()}


def test_the_lines_of_the_readme_run_as_they_stand(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (block,) = blocks("README.md")
    assert len(block.splitlines()) <= 12
    exec(compile(block, "README.md", "exec"), {})  # noqa: S102  # our own page
    assert {path.name for path in tmp_path.iterdir()} == {"sand.h5", "sand.png"}
    assert capsys.readouterr().out


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_runs_and_leaves_a_picture(example, tmp_path, monkeypatch):
    assert len(example.read_text(encoding="utf-8").splitlines()) < 60
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [str(example), "small"])
    runpy.run_path(str(example), run_name="__main__")
    assert list(tmp_path.glob(f"outputs/examples/{example.stem}*.png"))


LANDING = (
    "scene.particles_per_edge=4",
    "scene.centre=[0.5,0.38,0.5]",
    "simulation.steps=20",
    "simulation.backend=torch",
)
DATA = (*LANDING, "data.train_scenes=2", "data.validation_scenes=1", "data.keyframe_every=10")
FIT = ("model.width=8", "training.iterations=2", "training.check_every=2", "training.batch_segments=2", "picture=false")
SMALL = {"simulate": LANDING, "generate": DATA, "train": (*DATA, *FIT, "threads=1")}


@pytest.mark.usefixtures("own_registry")
@pytest.mark.slow
def test_the_commands_of_the_example_of_a_material_of_ones_own_run(in_process, tmp_path, monkeypatch):
    (plugin,) = (ROOT / "examples" / "05_your_own_material_on_the_command_line").glob("*.py")
    text = plugin.read_text(encoding="utf-8")
    assert len(text.splitlines()) < 60
    monkeypatch.syspath_prepend(plugin.parent)
    monkeypatch.delitem(sys.modules, plugin.stem, raising=False)
    commands = re.findall(r"^    python -m pcnclaws\.(\w+) (.*)$", text, re.MULTILINE)
    assert [entry for entry, _ in commands] == list(SMALL)
    for entry, options in commands:
        task = getattr(import_module(f"pcnclaws.{entry}"), entry)
        done = in_process(task, entry, *options.split(), *SMALL[entry])
        assert done.status == 0, done.err
    assert (tmp_path / "rubber.png").is_file()
    assert (tmp_path / "run" / "weights.safetensors").is_file()


@pytest.mark.slow
def test_wrong_kinds_are_refused_in_one_line_where_types_are_not_checked(tmp_path):
    code = """
import pcnclaws as pc
law, body = pc.analytic_law("sand"), pc.Body.cube(side=0.2, particles_per_edge=3)
for wrong in (
    lambda: pc.Scene(body, law, friction_angle="steep"),
    lambda: pc.Scene(body, law, friction_angle=True),
    lambda: pc.Scene(body, law, velocity="down"),
    lambda: pc.Scene(body, law, colliders=[body]),
    lambda: pc.Scene(body, law).simulate(steps=2.5),
    lambda: pc.Scene(body, law).simulate(steps=5, dtype="double"),
    lambda: pc.Scene(body, "sand"),
    lambda: pc.Scene("cube", law),
    lambda: pc.Scene(body, law, settings={"time_step": 1e-4}),
    lambda: pc.Settings(time_step="fast"),
    lambda: pc.Settings(gravity=-9.8),
    lambda: pc.Body.cube(side="long"),
    lambda: pc.Body.cube(centre=0.5),
    lambda: pc.Body.mesh(3),
    lambda: law.stress([[1.0, 0.0, 0.0]]),
    lambda: pc.load_law(None),
):
    try:
        wrong()
        print("accepted")
    except pc.UserError as error:
        print(error)
"""
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert len(lines) == 16, done.stdout
    assert all("accepted:" in line for line in lines), done.stdout
