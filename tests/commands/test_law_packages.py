"""Packaged laws: read back to the last bit, or refused in one line that says what is missing; nothing in them runs."""

import json
import pickle
import shutil
import struct
import zipfile
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import pytest
import torch
import yaml

import pcnclaws as pc
from pcnclaws.commands.law_package import write_package
from pcnclaws.commands.law_source import law_source
from pcnclaws.commands.runs import METRICS, PRETRAINED, WEIGHTS, model_for, start_run
from pcnclaws.data.hdf5 import read_scenes
from pcnclaws.data.law_packages import read_law_package
from pcnclaws.estimation.law_error import known_law_error
from pcnclaws.export import export
from pcnclaws.laws.materials import MATERIALS
from pcnclaws.laws.neural import build_neural_laws
from pcnclaws.simulate import simulate
from pcnclaws.simulation.law_simulator import LawSimulator
from pcnclaws.training.weights import model_weights, write_weights

MODEL = {"name": "pcnclaws", "width": 2}
RESULTS = {
    "training": {"training_scenes": 3, "positions_only": True, "iterations": 20, "best_iteration": 16,
                 "validation_mse": 4e-8, "ranges": {"youngs_modulus": [1e5, 2e5], "poissons_ratio": [0.1, 0.4],
                                                    "friction_angle": [20.0, 30.0]}},
    "provenance": {"command": "python -m pcnclaws.train material=sand", "seed": 0, "processor": "a processor",
                   "threads": 1, "precision": "float32", "torch": "2.13.0", "pcnclaws": "0.1.0", "commit": None},
    "seconds": 90.0,
    "history": {"loss": [1.0] * 1000},
    "scenes": [{"name": "test-1", "mse": 2.5e-8, "rms_percent": 0.05, "stress_error": None, "time": [0.0] * 100}],
}  # fmt: skip


def finished_run(folder: Path) -> Path:
    """A finished run on the user's own trajectories."""
    data = {"trajectories": "mine.h5", "seed": 0}
    start_run(folder, {"material": {"name": "sand"}, "model": MODEL, "plugins": ["my_sand"], "data": data})
    torch.manual_seed(1)
    weights = model_weights(LawSimulator(build_neural_laws(MATERIALS["sand"], MODEL)))
    write_weights(folder / WEIGHTS, weights, {"ranges": RESULTS["training"]["ranges"]})
    (folder / METRICS).write_text(json.dumps(RESULTS))
    return folder


@pytest.fixture
def run(tmp_path: Path) -> Path:
    return finished_run(tmp_path / "run")


@pytest.fixture(scope="module")
def written_package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("packages")
    write_package(law_source(str(finished_run(folder / "run")), None), folder / "law.zip")
    return folder / "law.zip"


@pytest.fixture
def package(written_package: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return Path(shutil.copy(written_package, "law.zip"))


@pytest.mark.slow
def test_a_shipped_law_taken_along_moves_bodies_to_the_same_bits(in_process: Callable[..., Any]) -> None:
    done = in_process(export, "export", "law=sand", "output=sand.zip")
    assert (done.status, done.err) == (0, "")
    assert done.out == f"wrote sand.zip: law 'sand' of sand, {Path('sand.zip').stat().st_size / 1000:.0f} kB\n"
    scene = ("material=sand", "simulation.steps=5", "scene.particles_per_edge=3", "scene.side=0.2", "picture=false")
    for law, output in (("pretrained", "a.h5"), ("sand.zip", "b.h5")):
        assert in_process(simulate, "simulate", *scene, f"law={law}", f"output={output}").status == 0
    ours, theirs = (read_scenes(Path(name))[0].position for name in ("a.h5", "b.h5"))
    assert (ours == theirs).all()
    assert known_law_error(Path("sand.zip")) == known_law_error(PRETRAINED / "sand")
    assert b"Errors on objects" in read_law_package(Path("sand.zip"))["card.md"]
    assert in_process(export, "export", "law=sand.zip", "output=again", "format=zip").status == 0
    assert Path("again.zip").read_bytes() == Path("sand.zip").read_bytes()


def test_the_package_of_a_run_says_what_there_is_to_know(run: Path, package: Path) -> None:
    law, own = pc.load_law(package), pc.load_law(run)
    F = torch.eye(3) + 0.1 * torch.randn(5, 3, 3)  # noqa: N806  # the textbook's letter
    known: dict[str, Any] = {"youngs_modulus": 1e5, "poissons_ratio": 0.3, "friction_angle": 25.0}
    assert torch.equal(law.stress(F, **known), own.stress(F, **known))
    assert torch.equal(law.return_map(F, **known), own.return_map(F, **known))
    assert law.ranges == own.ranges == {name: tuple(span) for name, span in RESULTS["training"]["ranges"].items()}
    members = read_law_package(package)
    about = json.loads(members["law.json"])
    assert about["versions"]["pcnclaws"] == pc.__version__
    assert about["plugins"] == ["my_sand"]
    assert about["parameters"]["friction_angle"] == {"unit": "deg", "training_range": [20.0, 30.0]}
    for words in ("own trajectories", "positions only", "2.5e-08", "friction_angle 20 to 30 deg", "pcnclaws 0.1.0"):
        assert words in members["card.md"].decode()
    kept = json.loads(members["metrics.json"])
    assert "history" not in kept
    assert kept["scenes"][0].keys() == {"name", "mse", "rms_percent", "stress_error"}
    assert known_law_error(package) == pytest.approx(2e-4)  # of its validation


def changed(package: Path, **members: bytes | None) -> Path:
    """The package with other members; None takes one away."""
    with zipfile.ZipFile(package) as archive:
        content: dict[str, bytes | None] = {name: archive.read(name) for name in archive.namelist()}
    content |= {name.replace("_", "."): text for name, text in members.items()}
    with zipfile.ZipFile("changed.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in content.items():
            if text is not None:
                archive.writestr(name, text)
    return Path("changed.zip")


def about_with(package: Path, **fields: object) -> bytes:
    return json.dumps(json.loads(read_law_package(package)["law.json"]) | fields).encode()


def config_with(**fields: object) -> bytes:
    return yaml.safe_dump({"material": {"name": "sand"}, "model": MODEL, "plugins": ["my_sand"], **fields}).encode()


def refused(path: Path) -> str:
    with pytest.raises(pc.UserError) as error:
        pc.load_law(path)
    assert "\n" not in str(error.value)
    assert "/tmp" not in str(error.value).replace(str(path), "")  # noqa: S108  # the package is named, no copy of it
    return str(error.value)


def test_what_a_package_lacks_here_is_said_in_one_line(package: Path) -> None:
    later = {"pcnclaws": "9.1"}
    said = refused(changed(package, law_json=about_with(package, version=2, versions=later)))
    assert said == (
        "law=changed.zip is of format 2, which pcnclaws 9.1 has written; pcnclaws 0.1.0 reads up to format 1; "
        "accepted: a later version of pcnclaws"
    )
    said = refused(changed(package, config_yaml=config_with(material={"name": "my_sand"})))
    assert "material='my_sand' is not known" in said
    assert "the run was made with plugins=[my_sand], which this command was not given" in said
    newer = about_with(package, versions=later)
    said = refused(changed(package, law_json=newer, config_yaml=config_with(model={**MODEL, "depth": 3})))
    assert "changed.zip/config.yaml: model='depth' is not known" in said
    assert said.endswith("pcnclaws 9.1 wrote it, this is 0.1.0")
    said = refused(changed(package, config_yaml=config_with(model={"name": "pcnclaws", "width": 4})))
    assert "do not fit the configuration" in said


def test_a_material_of_a_plugin_is_taken_along_and_its_plugin_is_asked_for(
    run: Path, in_process: Callable[..., Any], own_registry: None
) -> None:
    ranges = {"youngs_modulus": (1.0, 2.0), "poissons_ratio": (0.1, 0.3)}
    pc.register(pc.Material("my_sand", "pcnclaws.laws.elasticity:StVKHencky", None, ranges))
    own = MATERIALS["my_sand"]
    weights = model_weights(LawSimulator(build_neural_laws(own, MODEL)))
    start_run(
        run, {"material": {"name": "my_sand"}, "model": MODEL, "plugins": ["mine"], "data": {"trajectories": "x"}}
    )
    write_weights(run / WEIGHTS, weights, {})
    assert in_process(export, "export", f"law={run}", "output=law.zip").status == 0
    assert pc.load_law("law.zip").material == own
    assert model_for("law.zip", own).laws is not None
    del MATERIALS["my_sand"]
    assert "plugins=[mine]" in refused(Path("law.zip"))


class Payload:
    """Leaves a mark where it is unpickled."""

    def __reduce__(self) -> Any:
        return Path.touch, (Path("mark"),)


def _written(**members: bytes) -> bytes:
    file = BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in members.items():
            archive.writestr(name, text)
    return file.getvalue()


def _many(_: Path) -> bytes:
    file = BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for number in range(100):
            archive.writestr(f"{number}", b"")
    return file.getvalue()


def _twice(package: Path) -> bytes:
    content = bytearray(changed(package, card_me=b"x").read_bytes())
    return bytes(content.replace(b"card.me", b"card.md"))


def _understated(package: Path) -> bytes:
    """A member of 2 MB that says of itself to have 10 bytes, in both places."""
    content = bytearray(changed(package, card_md=bytes(2 * 10**6)).read_bytes())
    return bytes(content.replace(struct.pack("<I", 2 * 10**6), struct.pack("<I", 10)))


HOSTILE: dict[str, tuple[Callable[[Path], bytes], str]] = {
    "a path above": (lambda p: changed(p, **{"../evil_py": b"x"}).read_bytes(), "it has a member '../evil.py'"),
    "an absolute path": (lambda p: changed(p, **{"/etc/evil": b"x"}).read_bytes(), "it has a member '/etc/evil'"),
    "a path of Windows": (lambda p: changed(p, **{"c:\\evil": b"x"}).read_bytes(), "it has a member"),
    "a member twice": (_twice, "it has a member 'card.md'"),
    "bytes that are missing": (lambda p: p.read_bytes()[4:], "damaged"),
    "a bomb": (lambda p: changed(p, card_md=bytes(2 * 10**6)).read_bytes(), "card.md is larger than 1 MiB"),
    "a bomb that understates itself": (_understated, "damaged"),
    "huge weights": (lambda p: changed(p, weights_safetensors=bytes(7 * 10**7)).read_bytes(), "larger than 64 MiB"),
    "many members": (_many, "more than 64 members"),
    "pickled weights": (lambda p: changed(p, weights_safetensors=pickle.dumps(Payload())).read_bytes(), "is damaged"),
    "a pickle": (lambda p: pickle.dumps(Payload()), "is no packaged law"),
    "a saved module": (lambda p: _written(**{"archive/data.pkl": pickle.dumps(Payload())}), "it has a member"),
    "objects of YAML": (
        lambda p: changed(p, config_yaml=b"material: !!python/object/apply:pathlib.Path.touch [mark]").read_bytes(),
        "cannot be read",
    ),
    "another archive": (lambda p: _written(position=b"1"), "law.json is missing"),
    "no weights": (lambda p: changed(p, weights_safetensors=None).read_bytes(), "weights.safetensors is missing"),
    "cut off": (lambda p: p.read_bytes()[:-100], "is no packaged law"),
    "other bytes": (lambda p: p.read_bytes().replace(b"PK\3\4", b"PK\3\5"), "damaged"),
    "empty": (lambda p: b"", "is no packaged law"),
    "nested JSON": (lambda p: changed(p, law_json=b"[" * 10**5).read_bytes(), "law.json cannot be read"),
    "a number for JSON": (lambda p: changed(p, law_json=b"1").read_bytes(), "law.json says something else"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_what_is_no_package_or_a_hostile_one_is_one_line_and_runs_nothing(name: str, package: Path) -> None:
    make, words = HOSTILE[name]
    content = make(package)
    Path("x.zip").write_bytes(content)
    assert words in refused(Path("x.zip"))
    assert not Path("mark").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("law=sand",), "name no format; accepted: format=zip, cpp, pt2, onnx, or"),
        (("law=sand", "format=zap"), "format='zap' is not known; accepted: "),
        (("law=snd", "output=x.zip"), "did you mean 'sand'?"),
        (("law=tresca", "output=x.zip"), "no weights ship for tresca"),
        (("law=analytic", "output=x.zip"), "law=analytic needs material=; accepted: elasticity, "),
        (("law=analytic", "material=sand", "output=x.zip"), "has no weights to package"),
        (("law=sand", "material=plasticine", "output=x.zip"), "law=sand was trained for material=sand, not plasticine"),
        (("law=sand", "frame=1", "output=x.zip"), "frame=1 has no effect without trajectory"),
        (("trajectory=x.h5", "material=sand", "output=x.vtu"), "material=sand has no effect beside trajectory"),
        (("law=sand", "output=there.zip"), "output=there.zip is a folder"),
        (("law=there.zip", "output=x.zip"), "config.yaml is missing"),
    ],
)
def test_wrong_input_is_one_line_and_leaves_nothing(
    arguments: tuple[str, ...], words: str, in_process: Callable[..., Any], tmp_path: Path
) -> None:
    (tmp_path / "there.zip").mkdir()
    done = in_process(export, "export", *arguments)
    assert done.status == 2
    assert words in done.err
    assert done.err.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["there.zip"]


def test_a_package_is_not_lost_to_one_made_of_it_and_an_unfinished_run_makes_none(
    in_process: Callable[..., Any], run: Path, package: Path
) -> None:
    assert "which would be lost" in in_process(export, "export", "law=law.zip", "output=law.zip").err
    (run / METRICS).unlink()
    assert "accepted: a finished run" in in_process(export, "export", f"law={run}", "output=x.zip").err
    (run / METRICS).write_text("{}")
    assert "is not what a finished run leaves" in in_process(export, "export", f"law={run}", "output=x.zip").err
    assert not Path("x.zip").exists()
