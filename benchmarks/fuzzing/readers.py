"""The readers of files that are fuzzed: what each command does with a file before any work begins."""

import tempfile
from collections.abc import Callable
from pathlib import Path

from benchmarks.fuzzing.imported_readers import IMPORTED
from benchmarks.fuzzing.reader import Reader
from pcnclaws.commands.runs import CONFIG, METRICS, WEIGHTS, load_run, run_errors
from pcnclaws.data.first_motion import name_contradictions
from pcnclaws.data.generation import read_manifest
from pcnclaws.data.hdf5 import read_scenes
from pcnclaws.data.observation_files import from_record, from_table
from pcnclaws.data.point_files import read_point_file
from pcnclaws.data.restart_files import restart
from pcnclaws.data.units import check_record
from pcnclaws.errors import UserError
from pcnclaws.estimation.law_error import known_law_error
from pcnclaws.geometry.shapes import mesh_particles, particles
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.simulation.scenes import start_of
from pcnclaws.training.checkpoints import newest_checkpoint

# A whole run folder, beside the inputs.
RUN = "run"


def _trajectory(path: Path) -> None:
    for record in read_scenes(path):
        name_contradictions([record])
        check_record(record)
        start_of(record)
        if record.material in MATERIALS:
            from_record(record)
        if record.keyframes is not None:
            restart(record, 0, "frame")


def _markers(path: Path) -> None:
    body = particles(side=0.2, particles_per_edge=3, lattice="centres")
    from_table(path, "sand", SimulationSettings(), body, velocity_known=True)


def _mesh(path: Path) -> None:
    mesh_particles(path, particles_per_edge=4)


def _run_with(name: str) -> Callable[[Path], None]:
    """A run folder of which one file is the given one."""

    def read(path: Path) -> None:
        with tempfile.TemporaryDirectory() as folder:
            run = Path(folder)
            for member in (path.parent / RUN).iterdir():
                (run / member.name).symlink_to(member.absolute())
            (run / name).unlink(missing_ok=True)
            (run / name).symlink_to(path.absolute())
            load_run(run)
            run_errors(run)
            known_law_error(run)

    return read


def _checkpoint(path: Path) -> None:
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "last.ckpt").symlink_to(path.absolute())
        if newest_checkpoint(Path(folder)) is None:
            raise UserError("no checkpoint that can be read")


READERS = {
    "trajectory": Reader(".h5", _trajectory),
    "points": Reader(".npz", read_point_file),
    "markers": Reader(".csv", _markers),
    "mesh_obj": Reader(".obj", _mesh),
    "mesh_ply": Reader(".ply", _mesh),
    "mesh_stl": Reader(".stl", _mesh),
    "mesh_off": Reader(".off", _mesh),
    "mesh_glb": Reader(".glb", _mesh),
    "weights": Reader(".safetensors", _run_with(WEIGHTS)),
    "configuration": Reader(".yaml", _run_with(CONFIG)),
    "metrics": Reader(".json", _run_with(METRICS)),
    "manifest": Reader(".json", read_manifest),
    "checkpoint": Reader(".ckpt", _checkpoint),
    **IMPORTED,
}
