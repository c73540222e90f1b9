"""What others made is read and never run: payloads leave no mark, claims take no memory, one line each."""

import io
import json
import os
import pickle
import resource
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import torch
import yaml
from conftest import Outcome
from recordings import written

from pcnclaws.commands.runs import CONFIG, METRICS, WEIGHTS, start_run
from pcnclaws.data.hdf5 import read_scenes
from pcnclaws.data.point_files import read_point_file
from pcnclaws.errors import UserError
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.laws.neural import build_neural_laws
from pcnclaws.simulate import simulate
from pcnclaws.simulation.law_simulator import LawSimulator
from pcnclaws.train import train
from pcnclaws.training.checkpoints import LAST, newest_checkpoint
from pcnclaws.training.weights import model_weights, write_weights

MODEL = {"name": "pcnclaws", "width": 2}


class Payload:
    """Leaves a mark where it is unpickled."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> Any:
        return Path.touch, (self.mark,)


def _run_folder(folder: Path) -> Path:
    """A whole run folder of a small law of sand."""
    start_run(folder, {"material": {"name": "sand"}, "model": MODEL})
    write_weights(folder / WEIGHTS, model_weights(LawSimulator(build_neural_laws(MATERIALS["sand"], MODEL))), {})
    (folder / METRICS).write_text("{}")
    return folder


def _pickled(mark: Path) -> bytes:
    return pickle.dumps(Payload(mark))


def _torch_saved(mark: Path) -> bytes:
    file = io.BytesIO()
    torch.save({"state_dict": Payload(mark)}, file)
    return file.getvalue()


def _of_objects(mark: Path) -> bytes:
    file, cell = io.BytesIO(), np.empty(1, object)
    cell[0] = Payload(mark)
    np.savez(file, position=cell, velocity=np.zeros((1, 3)), volume=np.ones(1))
    return file.getvalue()


def _pickled_member(mark: Path) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("position.npy", _pickled(mark))
    return file.getvalue()


def _law(name: str, make: Callable[[Path], bytes | str]) -> Callable[[Path], list[str]]:
    """A run folder of which one file is another."""

    def options(mark: Path) -> list[str]:
        content = make(mark)
        path = _run_folder(Path("run")) / name
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return ["law=run"]

    return options


def _file(name: str, option: str, make: Callable[[Path], bytes | str]) -> Callable[[Path], list[str]]:
    def options(mark: Path) -> list[str]:
        content = make(mark)
        Path(name).write_bytes(content.encode() if isinstance(content, str) else content)
        return [f"{option}={name}"]

    return options


def _plugins(mark: Path) -> str:
    Path("evil.py").write_text(f"import pathlib; pathlib.Path({str(mark)!r}).touch()")
    return yaml.safe_dump({"material": {"name": "evil"}, "model": MODEL, "plugins": ["evil"]})


def _safetensors(header: dict[str, Any] | None, length: int | None = None, data: bytes = bytes(64)) -> bytes:
    text = json.dumps(header or {}).encode()
    return struct.pack("<Q", len(text) if length is None else length) + text + data


def _tensor(begin: int, end: int, shape: list[int]) -> dict[str, Any]:
    return {"dtype": "F32", "shape": shape, "data_offsets": [begin, end]}


def _laughs(_: Path) -> str:
    """A billion laughs: aliases of aliases."""
    lines = ["a: &a [x, x, x, x, x, x, x, x, x]"]
    lines += [f"{b}: &{b} [{', '.join([f'*{a}'] * 9)}]" for a, b in zip("abcdefgh", "bcdefghi", strict=True)]
    return "\n".join([*lines, "material: {name: *i}", "model: {name: *i}"])


def _gltf(mark: Path) -> str:
    Path("secret.bin").write_bytes(bytes(96))
    views = [{"buffer": 0, "byteOffset": 0, "byteLength": 48}]
    mesh = {"primitives": [{"attributes": {"POSITION": 0}}]}
    return json.dumps(
        {
            "asset": {"version": "2.0"},
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "meshes": [mesh],
            "buffers": [{"byteLength": 96, "uri": "secret.bin"}],
            "bufferViews": views,
            "accessors": [{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"}],
        }
    )


def _scene(change: Callable[[h5py.Group], object]) -> Callable[[Path], bytes]:
    def make(mark: Path) -> bytes:
        with h5py.File(written(Path("whole.h5")), "a") as file:
            change(file["scenes/thrown"])  # pyright: ignore[reportArgumentType]
        return Path("whole.h5").read_bytes()

    return make


def _references(scene: h5py.Group) -> None:
    del scene["volume"]
    scene.create_dataset("volume", data=[scene.ref] * 5, dtype=h5py.ref_dtype)


def _replaced(name: str, link: object) -> Callable[[h5py.Group], object]:
    def change(scene: h5py.Group) -> None:
        del scene[name]
        scene[name] = link

    return change


def _bomb(scene: h5py.Group) -> None:
    """12 GB of zeros in some MB, of which no chunk is written twice."""
    del scene["position"]
    scene.create_dataset("position", (4, 10**9, 3), "f4", chunks=(1, 10**6, 3), compression="gzip")


def _pickle_attribute(mark: Path) -> Callable[[h5py.Group], object]:
    return lambda scene: scene.attrs.__setitem__("material", np.void(_pickled(mark)))


PAYLOADS: dict[str, Callable[[Path], list[str]]] = {
    "npz of objects": _file("x.npz", "scene.particles", _of_objects),
    "npz of a pickle": _file("x.npz", "scene.particles", _pickled_member),
    "pickle for npz": _file("x.npz", "scene.particles", _pickled),
    "pickle for h5": _file("x.h5", "scene.particles", _pickled),
    "pickle for a mesh": _file("x.stl", "scene.mesh", _pickled),
    "h5: external link": _file(
        "x.h5", "scene.particles", _scene(_replaced("position", h5py.ExternalLink("y.h5", "/p")))
    ),
    "h5: soft link": _file("x.h5", "scene.particles", _scene(_replaced("position", h5py.SoftLink("/scenes")))),
    "h5: references": _file("x.h5", "scene.particles", _scene(_references)),
    "h5: a bomb": _file("x.h5", "scene.particles", _scene(_bomb)),
    "h5: a pickle": lambda mark: _file("x.h5", "scene.particles", _scene(_pickle_attribute(mark)))(mark),
    "pickle for weights": _law(WEIGHTS, _pickled),
    "torch.save for weights": _law(WEIGHTS, _torch_saved),
    "weights: huge header": _law(WEIGHTS, lambda mark: _safetensors({}, 2**62)),
    "weights: offsets overlap": _law(
        WEIGHTS, lambda mark: _safetensors({"a": _tensor(0, 8, [2]), "b": _tensor(4, 12, [2])})
    ),
    "weights: offsets beyond": _law(WEIGHTS, lambda mark: _safetensors({"a": _tensor(0, 2**40, [2**38])})),
    "weights: no notes": _law(WEIGHTS, lambda mark: _safetensors({"a": _tensor(0, 64, [16])})),
    "yaml: an object": _law(CONFIG, lambda mark: f"material: !!python/object/apply:pathlib.Path.touch ['{mark}']"),
    "yaml: a new object": _law(CONFIG, lambda mark: f"!!python/object/new:os.system ['touch {mark}']"),
    "yaml: aliases": _law(CONFIG, _laughs),
    "yaml: itself": _law(CONFIG, lambda mark: "&a [*a]"),
    "yaml: nested": _law(CONFIG, lambda mark: "[" * 100_000),
    "yaml: a number": _law(CONFIG, lambda mark: "material: " + "9" * 10_000),
    "yaml: a class": _law(
        CONFIG, lambda mark: yaml.safe_dump({"material": {"name": "sand"}, "model": {"_target_": "x"}})
    ),
    "yaml: a plugin": _law(CONFIG, _plugins),
    "gltf: a buffer elsewhere": _file("x.gltf", "scene.mesh", _gltf),
    "ply: a billion vertices": _file(
        "x.ply",
        "scene.mesh",
        lambda mark: (
            "ply\nformat binary_little_endian 1.0\nelement vertex 1000000000\nproperty double x\n"
            "property double y\nproperty double z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
        ),
    ),
    "stl: four billion triangles": _file("x.stl", "scene.mesh", lambda mark: bytes(80) + b"\xff" * 4 + bytes(200)),
    "mesh: an archive": _file("x.zip", "scene.mesh", _of_objects),
}


@pytest.mark.parametrize("name", PAYLOADS)
def test_a_payload_is_refused_with_one_line_and_leaves_no_mark(
    name: str, in_process: Callable[..., Outcome], tmp_path: Path
) -> None:
    mark = tmp_path / "mark"
    options = PAYLOADS[name](mark)
    done = in_process(simulate, "simulate", "material=sand", "simulation.steps=5", "output=out.h5", *options)
    assert (done.status, done.err.count("\n")) == (2, 1), done.err
    assert not mark.exists()
    assert not Path("out.h5").exists()


def test_an_obj_names_a_file_of_materials_that_nobody_opens(in_process: Callable[..., Outcome], tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.mtl")  # whoever opens it waits for ever
    corners, faces = ("0 0 0", "1 0 0", "0 1 0", "0 0 1"), ("1 3 2", "1 2 4", "1 4 3", "2 3 4")
    lines = ["mtllib a.mtl", "usemtl b", *(f"v {one}" for one in corners), *(f"f {one}" for one in faces)]
    Path("x.obj").write_text("\n".join(lines))
    options = (
        "material=sand",
        "scene.mesh=x.obj",
        "scene.particles_per_edge=12",
        "simulation.steps=5",
        "picture=false",
    )
    assert in_process(simulate, "simulate", *options, "output=out.h5").status == 0


@pytest.mark.slow
def test_a_checkpoint_with_a_payload_is_passed_over_and_one_of_another_run_is_one_line(
    in_process: Callable[..., Outcome], tmp_path: Path
) -> None:
    from training_bodies import recorded

    from pcnclaws.data.hdf5 import write_scenes

    write_scenes(tmp_path / "bodies.h5", recorded(2))
    options = ("material=elasticity", "model.width=4", "data.trajectories=bodies.h5", "picture=false", "output=run")
    options = (*options, "training.iterations=2", "training.check_every=1", "training.batch_segments=1")
    options = (*options, "training.segment_length.first=5", "training.segment_length.last=5")
    assert in_process(train, "train", *options).status == 0
    checkpoint = Path("run/checkpoints") / LAST
    (Path("run") / METRICS).unlink()
    for content in ({"state_dict": {"a": torch.zeros(2)}}, {"x": 1}, {"state_dict": 3, "loops": [1]}):
        torch.save(content, checkpoint)
        done = in_process(train, "train", *options)
        assert done.status == 2, done.err
        assert done.err.startswith(f"error: {checkpoint} does not fit this run")
        assert done.err.count("\n") == 1
    mark = tmp_path / "mark"
    checkpoint.write_bytes(_torch_saved(mark))
    assert newest_checkpoint(checkpoint.parent) != checkpoint
    checkpoint.write_bytes(_pickled(mark))
    assert newest_checkpoint(checkpoint.parent) != checkpoint
    assert not mark.exists()


def _claiming(path: Path) -> None:
    """10^9 particles that no disk holds: contiguous, their room in the file sparse."""
    with h5py.File(written(path), "a") as file:
        scene: Any = file["scenes/thrown"]
        del scene["position"]
        properties = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        properties.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
        properties.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
        space = h5py.h5s.create_simple((4, 10**8, 3))
        h5py.h5d.create(scene.id, b"position", h5py.h5t.IEEE_F32LE, space, properties)
        for name in ("velocity", "initial_velocity", "volume", "keyframes"):
            del scene[name]
        scene.create_dataset("volume", (10**8,), "f4", chunks=(10**6,), compression="gzip")


@pytest.mark.slow
def test_what_claims_to_be_large_is_refused_before_memory_is_taken(tmp_path: Path) -> None:
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    before = resource.getrlimit(resource.RLIMIT_AS)
    _claiming(tmp_path / "x.h5")
    size = (tmp_path / "x.h5").stat()
    assert size.st_blocks * 512 < 2**20 < 2**30 < size.st_size
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (10**9, 3)})
    with zipfile.ZipFile(tmp_path / "x.npz", "w") as archive:
        for name in ("position", "velocity", "volume"):
            archive.writestr(f"{name}.npy", header.getvalue())
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + 6 * 2**30, before[1]))
    try:
        with pytest.raises(UserError, match="too much for the memory here; accepted: at most") as refused:
            read_scenes(tmp_path / "x.h5")
        assert "\n" not in str(refused.value)
        with pytest.raises(UserError, match="more than it holds"):
            read_point_file(tmp_path / "x.npz")
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)
