"""Readers of what others bring: trajectories of other formats, measured stress, motion capture, packaged laws."""

from pathlib import Path

import numpy as np

from benchmarks.fuzzing.reader import Reader
from pcnclaws.commands.law_source import law_source
from pcnclaws.data.graph_network_files import METADATA
from pcnclaws.data.loading_path_files import read_loading_paths
from pcnclaws.data.motion_capture import Capture
from pcnclaws.data.observation_files import from_record, from_table
from pcnclaws.data.point_files import read_point_file
from pcnclaws.data.point_observation import from_points
from pcnclaws.data.trajectory_files import read_trajectories
from pcnclaws.data.units import check_record
from pcnclaws.geometry.shapes import particles
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.simulation.scenes import start_of

BODY = particles("cube", (0.5, 0.5, 0.5), 0.2, 3, "centres")
# Particles of the body that motion capture knows the places of.
FIXED = {"a": BODY.position[0], "b": BODY.position[2], "c": BODY.position[6]}
# A folder with a data set of graph network simulators.
GRAPH_NETWORK = "graph_network"
FRAME = '<VTKFile type="Collection"><Collection><DataSet timestep="0" file="{}"/></Collection></VTKFile>'


def _trajectory(path: Path) -> None:
    for record in read_trajectories(path, "sand"):
        check_record(record)
        if record.initial_velocity is not None:  # train finds those that a file does not hold
            start_of(record)
        from_record(record)


def _series(path: Path) -> None:
    """A series of one point cloud."""
    _trajectory(path.with_name(f"{path.stem}*{path.suffix}"))


def _frame(path: Path) -> None:
    """A collection of one frame."""
    collection = path.with_name("of_input.pvd")
    collection.write_text(FRAME.format(path.name), encoding="utf-8")
    _trajectory(collection)


def _stress(path: Path) -> None:
    read_loading_paths([path])


def _capture(path: Path) -> None:
    known = Capture("mm", {name: np.array(place) for name, place in FIXED.items()})
    from_table(path, "sand", SimulationSettings(), BODY, velocity_known=False, capture=known)


def _metadata(path: Path) -> None:
    """What stands beside a data set of graph network simulators."""
    (path.parent / GRAPH_NETWORK / METADATA).write_bytes(path.read_bytes())
    _trajectory(path.parent / GRAPH_NETWORK / "train.npz")


def _unlabelled(path: Path) -> None:
    from_points(path, "sand", SimulationSettings(), BODY, velocity_known=False)


def _unlabelled_series(path: Path) -> None:
    _unlabelled(path.with_name(f"{path.stem}*{path.suffix}"))


def _law(path: Path) -> None:
    law_source(str(path), None)


IMPORTED = {
    "point_cloud": Reader(".ply", read_point_file),
    "motion_npz": Reader(".npz", _trajectory),
    "motion_pvd": Reader(".pvd", _trajectory),
    "motion_vtu": Reader(".vtu", _frame),
    "motion_ply": Reader(".ply", _series),
    "motion_csv": Reader(".csv", _trajectory),
    "motion_gns": Reader(".npz", _trajectory),
    "metadata_gns": Reader(".json", _metadata),
    "unlabelled_csv": Reader(".csv", _unlabelled),
    "unlabelled_npz": Reader(".npz", _unlabelled),
    "unlabelled_ply": Reader(".ply", _unlabelled_series),
    "stress_csv": Reader(".csv", _stress),
    "stress_h5": Reader(".h5", _stress),
    "capture": Reader(".csv", _capture),
    "capture_c3d": Reader(".c3d", _capture),
    "packaged_law": Reader(".zip", _law),
}
