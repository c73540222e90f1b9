"""Seeds of what other programs bring, written by the package where it writes such files."""

import base64
import csv
import json
import shutil
import struct
import zlib
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np

from benchmarks.fuzzing.c3d_bytes import c3d_bytes
from benchmarks.fuzzing.imported_readers import FIXED, GRAPH_NETWORK
from pcnclaws.commands.runs import CONFIG, METRICS, WEIGHTS
from pcnclaws.data.graph_network_files import METADATA
from pcnclaws.data.law_packages import write_law_package
from pcnclaws.data.point_frames import PointFrames, write_point_frames
from pcnclaws.interface.motion import Motion
from pcnclaws.simulation.records import SceneRecord

# A frame as others write it: text, and base64 that zlib has compressed.
FRAME = """<!-- pcnclaws {notes} -->
<VTKFile type="UnstructuredGrid" header_type="UInt32" compressor="vtkZLibDataCompressor">
<UnstructuredGrid><Piece NumberOfPoints="3" NumberOfCells="0">
<Points><DataArray type="Float32" NumberOfComponents="3" format="binary">{points}</DataArray></Points>
<PointData><DataArray type="Float64" Name="volume" format="ascii">1e-4 1e-4 1e-4</DataArray>
<DataArray type="Float32" Name="velocity" NumberOfComponents="3" format="ascii">0 0 0 0 0 0 0 -1 0</DataArray>
</PointData></Piece></UnstructuredGrid></VTKFile>
"""
CLOUD = """ply
format ascii 1.0
comment time 0.5
comment pcnclaws {notes}
element vertex 3
property float x
property float y
property float z
property double volume
property int id
property float velocity_0
property float velocity_1
property float velocity_2
end_header
0.4 0.5 0.5 1e-4 3 0 0 0
0.5 0.5 0.5 1e-4 1 0 0 0
0.5 0.6 0.5 1e-4 2 0 0 -1
"""
TABLES = {
    "tension.csv": "lambda,lambda_2,P_kPa\n1,1,0\n1.1,0.95,3.2\n1.2,0.9,5\n",
    "shear.csv": "gamma,sigma_12_MPa\n0,0\n0.1,0.02\n0.3,0.06\n",
}


def write_imported_seeds(folder: Path, record: SceneRecord, run: Path) -> dict[str, list[Path]]:
    """Writes the seeds into a folder; the seeds by reader.

    record  of a short motion
    run     a run folder of a law
    """
    motion = Motion(replace(record, keyframes=None))
    paths = {ending: motion.save(folder / f"motion.{ending}", 0) for ending in ("npz", "pvd", "vtu", "ply", "csv")}
    notes = json.dumps({"youngs_modulus": 3e5, "poissons_ratio": 0.2, "friction_angle": 30.0})
    cloud, frame = CLOUD.format(notes=notes), FRAME.format(notes=notes, points=_compressed())
    written = {"cloud.ply": cloud, "frame.vtu": frame, **TABLES}
    for name, text in written.items():
        (folder / name).write_text(text, encoding="utf-8")
    write_law_package(
        folder / "law.zip",
        {"material": "sand", "plugins": []},
        {name: (run / name).read_bytes() for name in (CONFIG, WEIGHTS, METRICS)} | {"card.md": b"# A law of sand\n"},
    )
    return {
        "point_cloud": [folder / "cloud.ply", paths["ply"]],
        "motion_npz": [paths["npz"]],
        "motion_pvd": [paths["pvd"]],
        "motion_vtu": [folder / "frame.vtu", paths["vtu"]],
        "motion_ply": [folder / "cloud.ply", paths["ply"]],
        "motion_csv": [paths["csv"]],
        "motion_gns": _graph_network(folder, record),
        "metadata_gns": [folder / METADATA],
        **{f"unlabelled_{ending}": _unlabelled(folder / f"seen.{ending}") for ending in ("csv", "npz", "ply")},
        "stress_csv": [folder / name for name in TABLES],
        "stress_h5": [_loading_paths(folder / "stress.h5")],
        "capture": [_capture(folder / "capture.csv")],
        "capture_c3d": _capture_c3d(folder),
        "packaged_law": [folder / "law.zip"],
    }


def _compressed() -> str:
    """Points as base64 of one block that zlib has compressed."""
    points = np.array([[0.4, 0.5, 0.5], [0.5, 0.5, 0.5], [0.5, 0.6, 0.5]], "<f4").tobytes()
    block = zlib.compress(points)
    return "".join(
        base64.b64encode(part).decode("ascii") for part in (struct.pack("<4I", 1, len(points), 0, len(block)), block)
    )


def _graph_network(folder: Path, record: SceneRecord) -> list[Path]:
    """A data set of graph network simulators in both forms, and what stands beside it, here and in its own folder."""
    positions, kinds = record.position.astype(np.float32), np.full(record.position.shape[1], 6)
    trajectory = np.empty(2, dtype=object)
    trajectory[:] = [positions, kinds]
    together = np.empty(1, dtype=object)
    together[0] = [positions, kinds]
    apart, whole = folder / "train.npz", folder / "whole.npz"
    np.savez(apart, allow_pickle=True, simulation_trajectory_0=trajectory)
    np.savez_compressed(whole, allow_pickle=True, gns_data=together)
    notes = {"dt": 0.0025, "bounds": [[0.1, 0.9]] * 3, "dim": 3, "sequence_length": 3, "friction_angle": 30.0}
    (folder / METADATA).write_text(json.dumps(notes), encoding="utf-8")
    (folder / GRAPH_NETWORK).mkdir(exist_ok=True)
    shutil.copy(apart, folder / GRAPH_NETWORK)
    return [apart, whole]


def _unlabelled(path: Path) -> list[Path]:
    """Three frames of points on the surface of a body that does not move."""
    corners = 0.5 + 0.1 * np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    time = 0.01 * np.arange(3)
    frames = PointFrames(time, np.tile(corners, (3, 1)), np.repeat(np.arange(3), len(corners)))
    return write_point_frames(path, frames)[-1:]  # of a series the last: frames come after the start


def _loading_paths(path: Path) -> Path:
    """Two paths of a study."""
    stretch = np.linspace(1.0, 1.3, 4)
    with h5py.File(path, "w") as file:
        for name, kind in (("tension", "PK1"), ("compression", "cauchy")):
            group = file.create_group(f"study/{name}")
            deformation = np.tile(np.eye(3), (4, 1, 1))
            deformation[:, 0, 0] = stretch
            deformation[:, 1, 1] = deformation[:, 2, 2] = stretch**-0.5
            stress = np.zeros((4, 3, 3))
            stress[:, 0, 0] = 1e3 * (stretch - 1.0)
            group.attrs.update({"stress_type": kind, "unit": "Pa"})
            for key, values in (("F", deformation), ("stress", stress)):
                group.create_dataset(key, data=values, compression="gzip")
    return path


def _capture(path: Path) -> Path:
    """Three frames of a body that falls, in millimetres."""
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(["Frame", "Time (Seconds)", *(f"{name}.{axis}" for name in FIXED for axis in "XYZ")])
        for k in range(3):
            fall = np.array([0.0, -4.9 * (0.01 * k) ** 2, 0.0])
            rows.writerow([k, 0.01 * k, *(f"{x:.6g}" for one in FIXED.values() for x in 1e3 * (one + fall))])
    return path


def _capture_c3d(folder: Path) -> list[Path]:
    """The same three frames in both forms of storage."""
    fall = np.stack((np.zeros(3), -4.9 * (0.01 * np.arange(3)) ** 2, np.zeros(3)), axis=1)
    places = 1e3 * (np.array([*FIXED.values()]) + fall[:, None])
    paths = [folder / "integers.c3d", folder / "single.c3d"]
    for path, scale in zip(paths, (0.1, -0.1), strict=True):
        stored = np.rint(places / scale).astype(np.int16) if scale > 0 else places.astype(np.float32)
        path.write_bytes(c3d_bytes(stored, np.ones((3, 3), bool), [*FIXED], scale, 100.0, more={"UNITS": "mm"}))
    return paths
