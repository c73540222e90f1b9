"""Command lines under test: up to where work begins, in a child and a folder of its own."""

import io
import os
import tempfile
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

from hydra.core.global_hydra import GlobalHydra

from pcnclaws.commands import launcher
from pcnclaws.commands.configuration import execution_from, start_from
from pcnclaws.commands.observation_setup import observation_from
from pcnclaws.commands.runs import laws_for
from pcnclaws.commands.training_setup import check_training
from pcnclaws.errors import UserError
from pcnclaws.laws.materials import material_named
from pcnclaws.simulation.time_step import stability_of

COMMAND_LINES = "command_line"


def seed_command_lines(folder: Path) -> list[list[str]]:
    """Whole command lines, the command first; the files are those of the folder of seeds."""
    files = {name: (folder / name).absolute() for name in ("plain.h5", "points.npz", "markers.csv", "body.obj", "run")}
    plane = "scene.colliders=[{shape: plane, point: [0,0.1,0], normal: [0,1,0], friction: 0.3}]"
    small = ["scene.side=0.2", "scene.particles_per_edge=4", "picture=false", "threads=1", "device=cpu"]
    return [
        ["simulate", "material=sand", "law=analytic", "parameters.friction_angle=30", "output=x.h5", *small],
        [
            "simulate",
            "material=plasticine",
            plane,
            "scene.velocity=[0,-1,0.5]",
            "simulation.gravity=[0,-9.8,0]",
            *small,
        ],
        ["simulate", f"scene.particles={files['points.npz']}", "precision=float64", "simulation=fast"],
        [
            "simulate",
            f"scene.particles={files['plain.h5']}",
            "scene.frame=-1",
            "simulation.steps=5",
            "simulation.every=1",
        ],
        ["simulate", f"scene.mesh={files['body.obj']}", "scene.lattice=faces", "simulation.domain=null", *small],
        ["simulate", f"law={files['run']}", "simulation.time_step=auto", "simulation.skip=none", "scene.spin=[1,2,3]"],
        ["train", "experiment=sand_multi", "training.iterations=3", "training.learning_rate=0.05", "seed=1"],
        ["train", f"data.trajectories={files['plain.h5']}", "model=gns", "logger=csv", "trainer.accelerator=cpu"],
        ["train", "--multirun", "material=sand,elasticity", "seed=0,1", "training=thorough"],
        ["generate", "material=sand", "data.train_scenes=2", "simulation.boundary=slip", "simulation.friction=0"],
        ["evaluate", "material=sand", "law=pretrained", f"trajectories={files['plain.h5']}", "output=metrics.json"],
        ["evaluate", "material=elasticity", "task=geometry", "output=geometry.json", "simulation.backend=torch"],
        [
            "estimate",
            f"observation.file={files['markers.csv']}",
            "scene.shape=cube",
            "scene.centre=[0.5,0.5,0.5]",
            "scene.side=0.2",
        ],
        [
            "estimate",
            f"observation.file={files['plain.h5']}",
            "estimator=adam",
            "fixed.poissons_ratio=0.2",
            "screening=4",
        ],
        ["observe", f"file={files['plain.h5']}", "markers=0.1", "surface=true", "every=10", "noise=1e-3"],
        ["calibrate", "material=sand", f"law={files['run']}", "objects=2"],
    ]


def run_command_line(entry: str, arguments: Sequence[str]) -> None:
    """Runs a command up to where its work begins.

    raises  UserError with what it says where it is refused with one line, RuntimeError for everything else
    """
    out, err = io.StringIO(), io.StringIO()
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as folder, redirect_stdout(out), redirect_stderr(err):
        os.chdir(folder)
        GlobalHydra.instance().clear()  # of the command that this one is tried in, which would be in its way
        try:
            status = launcher.run(TASKS.get(entry, _nothing), entry, arguments)
        finally:
            os.chdir(before)
    said = err.getvalue()
    errors = [line for line in said.splitlines() if line.startswith("error:")]
    if "Traceback" in said or status not in (0, 2) or (status == 2 and not errors):
        raise RuntimeError(f"status {status} of {entry} {list(arguments)}: {said[-300:]}")
    if status == 2:
        raise UserError(errors[0])


def _simulate(config: Any) -> None:
    start = start_from(config)
    stability_of(start).check()
    execution_from(config)
    laws_for(config.law, material_named(config.material.name), [start.parameters])


def _estimate(config: Any) -> None:
    observation_from(config, material_named(config.material.name))


def _nothing(config: Any) -> None:
    pass


TASKS: dict[str, Callable[[Any], None]] = {"simulate": _simulate, "estimate": _estimate, "train": check_training}
