"""The console command `pcnclaws`: the commands by their names, help, and completion in a shell."""

import shutil
import subprocess
from pathlib import Path

import pytest

from pcnclaws.__main__ import run
from pcnclaws.commands.completion import SCRIPTS, candidates
from pcnclaws.commands.tasks import TASKS

ROOT = Path(__file__).parents[1]


def complete(line: str) -> list[str]:
    return candidates(line, list(TASKS))


def test_every_entry_point_is_a_command() -> None:
    modules = {path.stem for path in (ROOT / "pcnclaws").glob("*.py") if "launcher.main(" in path.read_text()}
    assert set(TASKS) == modules


def test_a_command_runs_as_its_module_does(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    options = ["law=analytic", "simulation.steps=5", "scene.particles_per_edge=3", "picture=false", "output=x.h5"]
    assert run(["simulate", *options]) == 0
    assert (tmp_path / "x.h5").is_file()
    assert run(["simulate", "simulation.stpes=3"]) == 2


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["simualte"], "error: command='simualte' is not known; accepted: calibrate, completion, estimate, evaluate, "),
        (["completion", "bsh"], "error: completion='bsh' is not known; accepted: bash, fish, zsh; did you mean 'bash'"),
        (["completion"], "error: completion='' is not known; accepted: bash, fish, zsh"),
    ],
)
def test_names_that_are_not_known_are_one_line(
    arguments: list[str], line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(arguments) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith(line)
    assert said.err.count("\n") == 1


@pytest.mark.parametrize("arguments", [[], ["--help"], ["-h"]])
def test_help_names_all_commands_and_what_they_do(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run(arguments) == 0
    said = capsys.readouterr().out
    assert all(f"  {name}" in said and str(task.__doc__).partition("\n")[0] in said for name, task in TASKS.items())


def test_completion_knows_commands_options_groups_and_choices() -> None:
    assert complete("pcnclaws si") == ["simulate"]
    assert complete("pcnclaws simulate mater") == ["material.", "material="]
    assert complete("pcnclaws simulate material=s") == ["material=sand"]
    assert complete("pcnclaws train experiment=sand_") == ["experiment=sand_multi", "experiment=sand_single"]
    # the parameters are those of the material that was chosen
    assert "parameters.yield_stress=" in complete("pcnclaws simulate material=plasticine parameters.")
    assert "parameters.yield_stress=" not in complete("pcnclaws simulate material=sand parameters.")
    assert complete("pcnclaws simulate materiel=sand simulation.st") == ["simulation.steps="]
    assert complete("pcnclaws simulate picture=") == ["picture=false", "picture=true"]
    assert complete("pcnclaws simulate --mul") == ["--multirun"]
    assert complete("pcnclaws simulate scene.mesh=bo") == []
    assert complete("pcnclaws simualte mat") == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("line", "replies"),
    [
        ("pcnclaws sim", ["simulate"]),
        ("pcnclaws simulate simulation.bo", ["simulation.boundary="]),
        ("pcnclaws train experiment=sand_m", ["sand_multi"]),  # bash keeps what is left of =
    ],
)
def test_bash_completes(line: str, replies: list[str], on_the_path: dict[str, str]) -> None:
    script = 'source <(pcnclaws completion bash); COMP_LINE="$1"; COMP_POINT=${#1}; _pcnclaws; echo "${COMPREPLY[@]}"'
    bash = shutil.which("bash")
    assert bash is not None
    done = subprocess.run(
        [bash, "-c", script, "bash", line], env=on_the_path, capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == replies


@pytest.mark.slow
@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_other_shells_read_their_script(shell: str, on_the_path: dict[str, str]) -> None:
    if shutil.which(shell) is None:
        pytest.skip(f"needs {shell}")
    subprocess.run([shell, "-n"], input=SCRIPTS[shell], env=on_the_path, text=True, check=True)
