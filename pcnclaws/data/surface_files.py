"""Surfaces of a recorded motion as files: a PLY mesh of triangles for each frame."""

from pathlib import Path

import numpy as np

from pcnclaws.atomic import replaced_file
from pcnclaws.data.motion_files import chosen_frames
from pcnclaws.data.scene_notes import line_of
from pcnclaws.geometry.reconstructed_surface import reconstructed_surface
from pcnclaws.simulation.records import SceneRecord


def write_surfaces(path: Path, record: SceneRecord, frame: int | None = None) -> list[Path]:
    """Writes the surface around the particles of each frame, and returns the files: NAME_000.ply, ...

    frame   the one that is written, counted from the end where it is negative, to `path` itself; None: all
    raises  UserError for a frame that does not exist, for particles without a surface, and without scikit-image
    """
    files = chosen_frames(path, len(record.time), frame)
    for k, file in files.items():
        seen = np.isfinite(record.position[k]).all(1)
        surface = reconstructed_surface(record.position[k][seen].astype(np.float64), record.volume[seen])
        _write_mesh(file, *surface, line_of({"time": float(record.time[k])}))
    return list(files.values())


def _write_mesh(path: Path, vertices: np.ndarray, faces: np.ndarray, comment: str) -> None:
    table = np.empty(len(faces), [("count", "u1"), ("vertices", "<i4", 3)])
    table["count"], table["vertices"] = 3, faces
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment {comment}",
        f"element vertex {len(vertices)}",
        *(f"property double {axis}" for axis in "xyz"),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header",
        "",
    ]
    with replaced_file(path) as part:
        part.write("\n".join(header).encode("ascii") + vertices.astype("<f8").tobytes() + table.tobytes())
