"""Time of a film: a recorded motion of many particles drawn by the command `render`, from its start to the file."""

import importlib.util
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from rich.table import Table

import pcnclaws as pc
from benchmarks.charts import COLOURS, chart, decorate, save, table_of
from benchmarks.checks import names, whole
from benchmarks.context import BenchmarkContext, Checkpointed
from pcnclaws.errors import UserError

ENDINGS = (".gif", ".mp4")
COLOURINGS = ("material", "body", "speed", "strain")
AIM = 60.0  # s, of 500 frames of 8000 particles


def run(options: Mapping[str, Any], context: BenchmarkContext) -> dict[str, Any]:
    """Seconds of each film, imports and reading included.

    {"particles", "frames", "aim": seconds, "rows": [{"ending", "colour", "seconds", "cpu_seconds", "megabytes"}]}

    cpu_seconds  of the processor: what the film takes on a machine that has nothing else to do
    """
    endings, colourings = names(options, "endings", ENDINGS), names(options, "colours", COLOURINGS)
    edge, frames = whole(options, "particles_per_edge", least=2), whole(options, "frames", least=2)
    if ".mp4" in endings and importlib.util.find_spec("imageio_ffmpeg") is None:
        raise UserError("problem.endings=[.mp4] needs pip install 'pcnclaws[video]'; accepted without: [.gif]")
    films = [(ending, colour) for ending in endings for colour in colourings]
    context.advance(0, 1 + len(films), "simulating")
    known = Checkpointed.load(context.folder, "rendering", dict(options))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _motion(edge, frames, context.seed).save(folder / "motion.h5")
        for number, (ending, colour) in enumerate(films, 1):
            context.advance(number, 1 + len(films), f"{ending}, {colour}")
            known.row(f"{ending} {colour}", lambda e=ending, c=colour: _film(folder, e, c, context))
    context.advance(1 + len(films), 1 + len(films), "done")
    rows = [known.rows[f"{ending} {colour}"] for ending, colour in films]
    return {"particles": edge**3, "frames": frames, "aim": AIM, "rows": rows}


def tables(document: Mapping[str, Any]) -> list[Table]:
    """Time and size of each film."""
    found = document["results"]
    title = f"a film of {found['frames']} frames of {found['particles']} particles"
    table = table_of(title, "ending", "colour", "seconds", "CPU s", "MB")
    for row in found["rows"]:
        table.add_row(
            row["ending"],
            row["colour"],
            f"{row['seconds']:.1f}",
            f"{row['cpu_seconds']:.1f}",
            f"{row['megabytes']:.1f}",
        )
    return [table]


def draw(document: Mapping[str, Any], folder: Path) -> list[Path]:
    """A bar for each film, beside the aim."""
    found = document["results"]
    figure, axis = chart()
    labels = [f"{row['ending']}, {row['colour']}" for row in found["rows"]]
    axis.barh(labels, [row["seconds"] for row in found["rows"]], color=COLOURS[0])
    axis.axvline(found["aim"], linestyle=":", color="0.5", label="aim")
    axis.invert_yaxis()
    decorate(axis, f"seconds of {found['frames']} frames of {found['particles']} particles", "")
    axis.legend(fontsize=8, frameon=False)
    return [save(figure, folder / f"{document['problem']}.png")]


def _motion(edge: int, frames: int, seed: int) -> pc.Motion:
    """A cube of sand that falls, spreads and comes to rest, with F of every frame."""
    torch.manual_seed(seed)
    body = pc.Body.cube(side=0.4, centre=(0.5, 0.4, 0.5), particles_per_edge=edge)
    scene = pc.Scene(body, pc.analytic_law("sand"), velocity=(1.0, -2.0, 0.5))
    return scene.simulate(steps=2 * (frames - 1), every=2, deformation=True)


def _film(folder: Path, ending: str, colour: str, context: BenchmarkContext) -> dict[str, Any]:
    film = folder / f"film{ending}"
    command = [sys.executable, "-m", "pcnclaws.render", "trajectory=motion.h5", f"colour={colour}", f"output={film}"]
    context.yardstick.measure()
    began, worked = time.monotonic(), _worked()
    # our own command with our own arguments, no shell
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)  # noqa: S603
    seconds, worked = time.monotonic() - began, _worked() - worked
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)}: {done.stderr.strip()}")
    size = film.stat().st_size / 1e6
    film.unlink()
    return {"ending": ending, "colour": colour, "seconds": seconds, "cpu_seconds": worked, "megabytes": size}


def _worked() -> float:
    """Processor time of the processes that have ended [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
