"""What a command has left in a folder: which files are not whole, and what those of the results hold."""

import hashlib
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from pcnclaws.atomic import PARTIAL_SUFFIX
from pcnclaws.commands.plain_yaml import read_plain_yaml
from pcnclaws.data.hdf5 import read_scenes
from pcnclaws.training.checkpoints import AtomicCheckpointIO
from pcnclaws.training.weights import read_weights

# Of results as JSON: what does not depend on the time that they took.
COMPARED = ("mse", "rms_percent", "parameters", "generation", "material")


def broken_files(folder: Path) -> list[str]:
    """Files that are there under their names and cannot be read."""
    found = []
    for path in _files(folder):
        try:
            READERS.get(path.suffix, Path.read_bytes)(path)
        except Exception as fault:  # whatever a broken file makes its reader meet
            found.append(f"broken: {path.relative_to(folder)} ({type(fault).__name__})")
    return found


def results_of(folder: Path) -> dict[str, str]:
    """What the trajectories, weights and numbers of a folder are, by path: equal for equal ones."""
    return {
        str(path.relative_to(folder)): DIGESTS[path.suffix](path) for path in _files(folder) if path.suffix in DIGESTS
    }


def other_results(expected: Mapping[str, str], found: Mapping[str, str]) -> list[str]:
    """Results that are lost, or not what they should be."""
    return [f"other result: {name}" for name in sorted(expected) if found.get(name) != expected[name]]


def _files(folder: Path) -> list[Path]:
    """All but what TensorBoard lets grow, and what a killed process may leave under a name of its own."""
    paths = (path for path in sorted(folder.rglob("*")) if path.is_file() and path.suffix != PARTIAL_SUFFIX)
    return [path for path in paths if "tensorboard" not in path.parts]


def _of_bytes(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _of_weights(path: Path) -> str:
    weights, _ = read_weights(path)
    content = b"".join(name.encode() + weights[name].numpy().tobytes() for name in sorted(weights))
    return hashlib.sha256(content).hexdigest()


def _of_numbers(path: Path) -> str:
    document: Any = json.loads(path.read_text(encoding="utf-8"))
    return json.dumps({name: document[name] for name in COMPARED if name in document}, sort_keys=True)


READERS: dict[str, Callable[[Path], object]] = {
    ".h5": read_scenes,
    ".safetensors": read_weights,
    ".yaml": read_plain_yaml,
    ".ckpt": lambda path: AtomicCheckpointIO().load_checkpoint(path),
    ".json": lambda path: json.loads(path.read_text(encoding="utf-8")),
}
DIGESTS: dict[str, Callable[[Path], str]] = {
    ".h5": _of_bytes,
    ".safetensors": _of_weights,
    ".json": _of_numbers,
}
