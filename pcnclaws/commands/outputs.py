"""Output paths: `output=`, looked at before the work begins."""

from collections.abc import Mapping
from pathlib import Path

from pcnclaws.commands.typed_groups import Scene
from pcnclaws.errors import UserError

TRAJECTORY, RESULT, TABLE = (".h5", ".hdf5"), (".json",), (".csv",)
# Endings that promise a format. Any other, such as that of x_0.5, is part of a name.
ARRAYS = (".h5", ".hdf5", ".nc", ".zarr", ".mat", ".npz", ".npy", ".parquet", ".pkl", ".pickle")
TEXTS = (".csv", ".tsv", ".xlsx", ".json", ".jsonl", ".yaml", ".yml", ".toml", ".xml", ".txt", ".md", ".html", ".pdf")
MESHES = (".ply", ".obj", ".stl", ".off", ".glb", ".gltf", ".fbx", ".abc", ".usd", ".usda", ".usdc", ".usdz", ".bgeo")
FIELDS = (".vtk", ".vtu", ".vtp", ".vts", ".vti", ".vtr", ".pvd", ".pvtu", ".xdmf", ".xmf", ".xyz", ".pcd", ".las")
PICTURES = (".png", ".jpg", ".jpeg", ".gif", ".bmp", ".tif", ".tiff", ".webp", ".svg", ".exr", ".mp4", ".mov", ".avi")
PROGRAMS = (".pt", ".pth", ".pt2", ".ckpt", ".onnx", ".safetensors", ".py", ".ipynb", ".zip", ".gz", ".tar", ".tgz")
FORMATS = frozenset((*ARRAYS, *TEXTS, *MESHES, *FIELDS, *PICTURES, *PROGRAMS))


def output_file(output: str, sources: Mapping[str, object], *endings: str) -> Path:
    """The path of `output=`: a file may be written there, and it does not end like one of another format.

    sources  paths of what is read, by option; None where nothing is
    endings  of the format that is written
    raises   UserError
    """
    path = Path(output)
    if path.is_dir():
        raise UserError(f"output={path} is a folder; accepted: the path of a file")
    if path.exists() and not path.is_file():
        raise UserError(f"output={path} is not a regular file; accepted: the path of a file")
    for option, source in sources.items():
        if source is not None and path.resolve() == Path(str(source)).resolve():
            raise UserError(f"output={path} is the file of {option}, which would be lost; accepted: another path")
    existing = next(parent for parent in path.absolute().parents if parent.exists())
    if not existing.is_dir():
        raise UserError(f"output={path} cannot be written: {existing} is not a folder; accepted: the path of a file")
    check_ending("output", path, *endings)
    return path


def scene_files(scene: Scene) -> dict[str, object]:
    """The files that a scene is read from, by option."""
    return {"scene.particles": scene.particles, "scene.mesh": scene.mesh}


def check_ending(option: str, path: str | Path, *endings: str) -> None:
    """Refuses a path that ends like a file of another format with a UserError.

    endings  of the format that is written, none for a folder
    """
    suffix = Path(path).suffix.lower()
    if suffix in FORMATS and suffix not in endings:
        kind = f"a file that ends in {' or '.join(endings)}" if endings else "the path of a folder"
        raise UserError(f"{option}={path} ends like a file of another format; accepted: {kind}, or no ending")
