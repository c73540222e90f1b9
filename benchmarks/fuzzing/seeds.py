"""Seeds of the fuzzing: small whole files of every kind, made by the writers of the package."""

import json
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
import yaml

from benchmarks.fuzzing.imported_seeds import write_imported_seeds
from benchmarks.fuzzing.readers import RUN
from pcnclaws.commands.runs import CONFIG, METRICS, WEIGHTS
from pcnclaws.data.hdf5 import write_scenes
from pcnclaws.data.observation_files import write_table
from pcnclaws.geometry.shapes import particles
from pcnclaws.laws.analytic import analytic_laws
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.laws.neural import build_neural_laws
from pcnclaws.mpm.colliders import Collider
from pcnclaws.mpm.loads import Load
from pcnclaws.mpm.settings import SimulationSettings
from pcnclaws.simulation.law_simulator import LawSimulator
from pcnclaws.simulation.recorded_runs import simulate_records
from pcnclaws.simulation.recording import FramePlan
from pcnclaws.simulation.records import SceneRecord
from pcnclaws.simulation.scenes import SceneStart
from pcnclaws.training.checkpoints import AtomicCheckpointIO
from pcnclaws.training.weights import model_weights, write_weights

MATERIAL = MATERIALS["sand"]
MODEL = {"name": "pcnclaws", "width": 2}
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def write_seeds(folder: Path) -> dict[str, list[Path]]:
    """Writes the seeds, and the run folder that some of them are part of, into a folder; the seeds by reader."""
    folder.mkdir(parents=True, exist_ok=True)
    _write_run(folder / RUN)
    body = particles(side=0.2, particles_per_edge=3, lattice="centres")
    plain, moved = _records()
    write_scenes(folder / "plain.h5", [plain])
    write_scenes(folder / "moved.h5", [moved])
    arrays = {"position": body.position, "velocity": body.velocity, "volume": body.volume}
    np.savez(folder / "points.npz", **arrays)  # pyright: ignore[reportArgumentType]
    arrays |= {"density": np.full(27, 1e3)}
    np.savez_compressed(folder / "packed.npz", **arrays)  # pyright: ignore[reportArgumentType]
    names = [str(k) for k in range(3)]
    write_table(folder / "markers.csv", np.arange(3) * 0.01, names, np.repeat(body.position[None, :3], 3, 0))
    meshes = _write_meshes(folder)
    (folder / "manifest.json").write_text(json.dumps({"generation": 1, "material": "sand", "data.every": 5}))
    weights = {"state_dict": {"a": torch.zeros(3)}, "loops": {"epoch": [1, {"done": True}]}, "epoch": 3, "name": "x"}
    AtomicCheckpointIO().save_checkpoint(weights, folder / "seed.ckpt")
    run = folder / RUN
    return {
        "trajectory": [folder / "plain.h5", folder / "moved.h5"],
        "points": [folder / "points.npz", folder / "packed.npz"],
        "markers": [folder / "markers.csv"],
        **meshes,
        "weights": [run / WEIGHTS],
        "configuration": [run / CONFIG],
        "metrics": [run / METRICS],
        "manifest": [folder / "manifest.json"],
        "checkpoint": [folder / "seed.ckpt"],
        **write_imported_seeds(folder, plain, run),
    }


def _records() -> list[SceneRecord]:
    """A scene of version 1 of the file, and one with all that version 2 may hold."""
    body = particles("cube", (0.5, 0.22, 0.5), 0.2, 3, "centres")
    settings = SimulationSettings()
    around = SimulationSettings(
        domain=((0.0, 0.0, 0.0), (1.0, 0.6, 1.0)),
        friction=0.3,
        colliders=(Collider.box(low=(0.3, 0.4, 0.3), high=(0.7, 0.5, 0.7), velocity=(0.0, -1.0, 0.0)),),
        loads=(Load((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), force=(1.0, 0.0, 0.0)),),
    )
    start = SceneStart("thrown", MATERIAL.name, settings, MATERIAL.defaults, body.position, body.velocity, body.volume)
    plan = FramePlan(10, 5, 5, velocities=True)
    starts = [start, replace(start, name="moved", settings=around)]
    return simulate_records(starts, analytic_laws(MATERIAL), plan)


def _write_run(folder: Path) -> None:
    """A run folder of a small law."""
    folder.mkdir(exist_ok=True)
    torch.manual_seed(0)
    law = LawSimulator(build_neural_laws(MATERIAL, MODEL))
    ranges = {name: list(span) for name, span in MATERIAL.ranges.items()}
    write_weights(folder / WEIGHTS, model_weights(law), {"ranges": ranges})
    config = {"material": {"name": MATERIAL.name}, "model": MODEL, "plugins": [], "training": {"iterations": 3}}
    (folder / CONFIG).write_text(yaml.safe_dump(config))
    (folder / METRICS).write_text(json.dumps({"mse": 1e-6, "training": {"validation_mse": 1e-6}}))


def _write_meshes(folder: Path) -> dict[str, list[Path]]:
    """A tetrahedron in every format that has a reader of its own."""
    vertices = [" ".join(map(str, corner)) for corner in CORNERS.tolist()]
    ones = [" ".join(str(k + 1) for k in face) for face in FACES.tolist()]
    named = [" ".join(f"{k + 1}/1" for k in face) for face in FACES.tolist()]
    zeros = [f"3 {' '.join(map(str, face))}" for face in FACES.tolist()]
    element = "element vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 4\n"
    header = f"{element}property list uchar int vertex_indices\nend_header\n"
    binary = CORNERS.astype("<f4").tobytes() + b"".join(struct.pack("<B3i", 3, *face) for face in FACES.tolist())
    triangles = [struct.pack("<12fH", *np.zeros(3), *CORNERS[face].ravel(), 0) for face in FACES.tolist()]
    loops = ["".join(f"vertex {vertices[k]}\n" for k in face) for face in FACES.tolist()]
    facets = "".join(f"facet normal 0 0 0\nouter loop\n{loop}endloop\nendfacet\n" for loop in loops)
    contents = {
        "body.obj": "".join(f"v {one}\n" for one in vertices) + "".join(f"f {one}\n" for one in ones),
        "named.obj": "mtllib a.mtl\nusemtl b\nvt 0 0\n"
        + "".join(f"v {one}\n" for one in vertices)
        + "".join(f"f {one}\n" for one in named),
        "text.ply": f"ply\nformat ascii 1.0\n{header}" + "\n".join([*vertices, *zeros, ""]),
        "binary.ply": f"ply\nformat binary_little_endian 1.0\n{header}".encode() + binary,
        "text.stl": f"solid x\n{facets}endsolid x\n",
        "binary.stl": bytes(80) + struct.pack("<I", 4) + b"".join(triangles),
        "body.off": "OFF\n4 4 6\n" + "\n".join([*vertices, *zeros, ""]),
        "body.glb": _glb(),
    }
    found: dict[str, list[Path]] = {}
    for name, content in contents.items():
        path = folder / name
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        found.setdefault(f"mesh_{path.suffix[1:]}", []).append(path)
    return found


def _glb() -> bytes:
    """The tetrahedron as binary glTF."""
    positions, indices = CORNERS.astype("<f4").tobytes(), FACES.astype("<u4").tobytes()
    views = [{"buffer": 0, "byteOffset": at, "byteLength": n} for at, n in ((0, 48), (48, 48))]
    accessors = [
        {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 1]},
        {"bufferView": 1, "componentType": 5125, "count": 12, "type": "SCALAR"},
    ]
    scene = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": 96}],
        "bufferViews": views,
        "accessors": accessors,
    }
    text = json.dumps(scene).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", 96, b"BIN\0") + positions + indices
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
