"""Trajectories from files of any format that is read: the trajectory file, .npz, CSV, VTK XML series and PLY series."""

from collections.abc import Callable, Sequence
from pathlib import Path

from pcnclaws.data.graph_network_files import is_graph_network_file, read_graph_network_file
from pcnclaws.data.hdf5 import read_scenes
from pcnclaws.data.motion_arrays import read_motion_arrays
from pcnclaws.data.motion_tables import read_motion_table
from pcnclaws.data.ply_series import read_ply_series
from pcnclaws.data.vtk_series import read_vtk_series
from pcnclaws.errors import UserError, unknown_name
from pcnclaws.simulation.records import SceneRecord

# Readers of one scene, by ending. A material is that of files that do not say theirs.
READERS: dict[str, Callable[[Path, str], SceneRecord]] = {
    ".npz": read_motion_arrays,
    ".csv": read_motion_table,
    ".pvd": read_vtk_series,
    ".ply": read_ply_series,
}


def read_trajectories(
    path: str | Path, material: str = "", names: Sequence[str] | None = None, with_keyframes: bool = True
) -> list[SceneRecord]:
    """The scenes of a file, as read_scenes; files of other formats than the trajectory file hold one, but for the .npz
    files of graph network simulators.

    path      NAME.npz, NAME.csv, NAME.pvd, a series of point clouds NAME_*.ply, or a trajectory file
    material  of files that do not say theirs
    raises    UserError, one line, for whatever is wrong with the file
    """
    path = Path(path)
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        if path.suffix.lower() == ".vtu":
            raise UserError(f"{path}: is one frame; accepted: the .pvd file that names the frames with their times")
        return read_scenes(path, names, with_keyframes)
    if path.suffix.lower() == ".npz" and is_graph_network_file(path):
        records = read_graph_network_file(path, material)
    else:
        records = [reader(path, material)]
    known = {record.name: record for record in records}
    for name in names or ():
        if name not in known:
            raise unknown_name("scene", name, known)
    return [known[name] for name in names] if names else records
