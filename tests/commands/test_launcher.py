"""Exit statuses and one-line errors of every command."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from pcnclaws.commands.typed_configs import SimulateConfig
from pcnclaws.errors import SimulationDiverged, UserError
from pcnclaws.simulate import simulate


def do_nothing(config: SimulateConfig) -> None:
    pass


def one_line(text: str) -> str:
    """The only line of an error message."""
    lines = text.splitlines()
    assert len(lines) == 1, text
    return lines[0]


def test_a_task_that_ends_well_exits_0_and_leaves_no_folder(in_process, tmp_path):
    seen = []
    assert in_process(seen.append, "simulate", "simulation.steps=7") == (0, "", "")
    assert seen[0].simulation.steps == 7
    assert list(tmp_path.iterdir()) == []


WRONG = {
    "simulation=[0,-1,0.5]": ("simulation=[0,-1,0.5] is not accepted; accepted: one of ", "paper"),
    f"{5000 * 'x'}=1": ("is not known; accepted: what --help lists",),
    f"material={5000 * 'x'}": ("is not accepted; accepted: one of ", "sand"),
    f"keyframe_every={5000 * 'x'}": ("keyframe_every=xxx", "a whole number"),
    "trainer.accelerator=cpu": ("option='trainer.accelerator' is not known; accepted: device, ",),
    "material=snad": ["material='snad'", "elasticity, neo_hookean, plasticine, sand", "did you mean 'sand'"],
    "simulation.stpes=3": ["'simulation.stpes'", "simulation.time_step", "did you mean 'simulation.steps'"],
    "+simulation.stpes=3": ["'simulation.stpes'", "did you mean 'simulation.steps'"],
    "materiel=sand": ["'materiel'", "did you mean 'material'"],
    "model=pcnclaws": ["'model'", "accepted:"],
    "+model=pcnclaws": ["'model.name'", "accepted:"],
    "parameters.youngs_modulus=nan": ["parameters.youngs_modulus=nan", "a finite number"],
    "simulation.grid_nodes=abc": ["simulation.grid_nodes=abc", "a whole number"],
    "~simulation.steps": ["'simulation.steps'", "missing"],
    "simulation.steps": ["'simulation.steps'", "option=value"],
    "simulation.steps=1,2": ["simulation.steps=1,2", "--multirun"],
    "material=null": ["material=null"],
    "output=${nowhere}": ["output", "nowhere"],
    "--fast": ["--fast"],
}


@pytest.mark.parametrize("argument", list(WRONG))
def test_wrong_input_exits_2_with_one_line_and_leaves_nothing(argument, in_process, tmp_path):
    ran = []
    outcome = in_process(ran.append, "simulate", argument)
    assert outcome.status == 2
    line = one_line(outcome.err)
    assert all(part in line for part in WRONG[argument]), line
    assert ran == []
    assert list(tmp_path.iterdir()) == []


def test_an_unknown_experiment_is_told_the_nearest_one(in_process):
    outcome = in_process(do_nothing, "train", "experiment=sand_mluti")
    assert outcome.status == 2
    assert "did you mean 'sand_multi'" in one_line(outcome.err)


def test_options_of_the_chosen_groups_are_known_and_others_are_not(in_process):
    assert in_process(do_nothing, "simulate", "material=plasticine", "parameters.yield_stress=3e3").status == 0
    outcome = in_process(do_nothing, "simulate", "material=elasticity", "parameters.yield_stress=3e3")
    assert outcome.status == 2
    assert "parameters.poissons_ratio" in one_line(outcome.err)


@pytest.mark.parametrize(("error", "status"), [(UserError("wrong"), 2), (SimulationDiverged("left"), 1)])
def test_our_own_errors_are_one_line(error, status, in_process):
    def task(config: SimulateConfig) -> None:
        raise error

    outcome = in_process(task, "simulate")
    assert outcome.status == status
    assert one_line(outcome.err) == f"error: {error}"


def test_a_message_of_several_lines_is_joined(in_process):
    def task(config: SimulateConfig) -> None:
        raise UserError("first\n  second")

    assert one_line(in_process(task, "simulate").err) == "error: first second"


@pytest.mark.parametrize("error", [RuntimeError("a bug"), ValueError("a bug"), KeyError("a bug"), OSError("a bug")])
def test_anything_else_exits_1_with_its_traceback_and_a_last_line(error, in_process):
    def task(config: SimulateConfig) -> None:
        raise error

    outcome = in_process(task, "simulate")
    assert outcome.status == 1
    assert "Traceback" in outcome.err
    assert outcome.err.splitlines()[-1].startswith(f"error: unexpected {type(error).__name__}: ")


def test_an_interruption_exits_1_without_a_traceback(in_process):
    def task(config: SimulateConfig) -> None:
        raise KeyboardInterrupt

    outcome = in_process(task, "simulate")
    assert outcome.status == 1
    assert one_line(outcome.err) == "error: interrupted"


def test_cfg_shows_the_options(command):
    shown = command("simulate", "--cfg", "job", "material=plasticine")
    assert shown.status == 0
    assert "yield_stress" in shown.out


def test_help_shows_the_groups_of_the_command_and_its_options(in_process):
    shown = in_process(simulate, "simulate", "--help", "material=plasticine")
    assert shown.status == 0
    assert str(simulate.__doc__) in shown.out
    assert "material         elasticity, neo_hookean, plasticine, sand, tresca" in shown.out
    assert "training" not in shown.out
    assert "    yield_stress: " in shown.out
    assert "picture: true" in shown.out
    wrong = in_process(simulate, "simulate", "--help", "material=sandd")
    assert wrong.status == 2
    assert "did you mean 'sand'" in one_line(wrong.err)


def test_help_that_nobody_reads_on_ends_without_a_word(tmp_path):
    """The other end of the pipe is closed, as by `| head -1`."""
    reading, writing = os.pipe()
    os.close(reading)
    call = [sys.executable, "-m", "pcnclaws.simulate", "--help"]
    with os.fdopen(writing) as closed:
        done = subprocess.run(call, stdout=closed, stderr=subprocess.PIPE, text=True, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")


def test_outputs_lie_in_the_working_folder(in_process):
    seen = []
    in_process(seen.append, "simulate")
    assert Path(seen[0].output) == Path("outputs/simulate/sand.h5")
