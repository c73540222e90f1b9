"""Folder of a search for parameters: where an interrupted one goes on, and how a finished one is known again."""

import json
import logging
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from pcnclaws.atomic import replaced_file
from pcnclaws.commands.outputs import scene_files
from pcnclaws.commands.plain_yaml import read_plain_yaml
from pcnclaws.commands.typed import plain
from pcnclaws.commands.typed_configs import EstimateConfig
from pcnclaws.errors import UserError

log = logging.getLogger(__name__)

# Options that do not change what a search does: an interrupted one goes on under others.
FREE_OPTIONS = ("output", "overwrite", "picture", "trajectory", "threads", "paths")
# The options of a search, noted as it begins.
NOTED = "search.yaml"


def search_folder(output: Path) -> Path:
    """Where an interrupted search is kept, beside the output."""
    folder = output.with_suffix("") if output.suffix else output.with_name(f"{output.name}_search")
    if folder.exists() and not folder.is_dir():
        raise UserError(f"output={output}: {folder} is a file, and the search needs a folder of that name")
    return folder


def started_search(config: EstimateConfig, output: Path) -> Path:
    """The folder of the search, which goes on with an interrupted one of the same options alone."""
    folder = search_folder(output)
    asked, noted = _asked(config), folder / NOTED
    same = noted.is_file() and _noted_options(noted) == asked
    if config.overwrite or not same:
        for name in ("checkpoints", "tensorboard"):
            shutil.rmtree(folder / name, ignore_errors=True)
    with replaced_file(noted) as part:
        part.write(yaml.safe_dump(asked, encoding="utf-8"))
    return folder


def _noted_options(noted: Path) -> object:
    """The options of an interrupted search; None where the file is damaged, which one line says."""
    try:
        return read_plain_yaml(noted)
    except UserError as fault:
        log.warning("%s: the search begins anew", fault)
        return None


def finished_search(config: EstimateConfig, output: Path) -> Mapping[str, Any] | None:
    """The result that these options left in `output`, after the files that it is made of; None where there is none."""
    noted = search_folder(output) / NOTED
    if config.overwrite or not output.is_file() or not noted.is_file() or _noted_options(noted) != _asked(config):
        return None
    named = [config.observation.file, config.law, *scene_files(config.scene).values()]
    files = [path for path in (Path(str(name)) for name in named if name is not None) if path.exists()]
    inside = [path / "weights.safetensors" for path in files if path.is_dir()]
    written = output.stat().st_mtime_ns
    if any(path.stat().st_mtime_ns > written for path in (noted, *files, *inside) if path.is_file()):
        return None
    try:
        return json.loads(output.read_text(encoding="utf-8"))
    except ValueError:
        return None


def _asked(config: EstimateConfig) -> dict[str, Any]:
    return {key: value for key, value in plain(config).items() if key not in FREE_OPTIONS}
