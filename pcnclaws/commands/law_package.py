"""Packaged law of a run folder: what its weights need to be read elsewhere, and what there is to know of them."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from pcnclaws.commands.law_card import CARD, card
from pcnclaws.commands.law_source import LawSource
from pcnclaws.commands.runs import CONFIG, METRICS, WEIGHTS, read_config
from pcnclaws.data.law_packages import law_files, write_law_package
from pcnclaws.errors import UserError
from pcnclaws.estimation.law_error import CALIBRATION

# Of the configuration, what a law is built from; of each test scene, what stays when its curves go.
KEPT = ("material", "model", "regime", "plugins")
CURVES = ("history",)
CURVES_OF_SCENE = ("time", "mse_by_frame")


def write_package(source: LawSource, output: Path) -> None:
    """Writes the packaged law of a run folder, of weights that ship, or of another package.

    raises  UserError for an analytic law, and for a run that is not finished
    """
    if source.folder is None:
        raise UserError(
            "law=analytic has no weights to package; accepted: the name of a material whose weights ship, the path of "
            "a run folder or of a packaged law"
        )
    with law_files(source.folder) as folder:
        config = read_config(folder)
        members = {WEIGHTS: (folder / WEIGHTS).read_bytes(), CARD: _card(folder, source, config)}
        if (folder / METRICS).is_file():
            members[METRICS] = f"{json.dumps(_without_curves(_metrics(folder)), indent=2)}\n".encode()
        if (folder / CALIBRATION).is_file():
            members[CALIBRATION] = (folder / CALIBRATION).read_bytes()
    kept = {name: config[name] for name in KEPT if config.get(name) is not None}
    members[CONFIG] = yaml.safe_dump(kept, sort_keys=False, encoding="utf-8")
    write_law_package(output, _about(source, kept), members)


def _about(source: LawSource, config: Mapping[str, Any]) -> dict[str, Any]:
    """What law.json says of the law."""
    model = source.model
    return {
        "material": model.material.name,
        "model": config["model"],
        "plugins": config.get("plugins", []),
        "parameters": {
            parameter.name: {"unit": parameter.unit, "training_range": list(model.ranges[parameter.name])}
            for parameter in model.physical_parameters
        },
        "internal_variables": list(model.internal_names),
    }


def _card(folder: Path, source: LawSource, config: Mapping[str, Any]) -> bytes:
    if (folder / CARD).is_file():
        return (folder / CARD).read_bytes()
    if not (folder / METRICS).is_file():
        raise UserError(f"law={folder}: {METRICS} is missing; accepted: a finished run")
    try:
        return card(source.model.material.name, config, _metrics(folder)).encode()
    except (LookupError, TypeError, ValueError, AttributeError) as fault:
        raise UserError(
            f"law={folder}: {METRICS} or {CONFIG} is not what a finished run leaves ({type(fault).__name__}: {fault})"
        ) from fault


def _metrics(folder: Path) -> dict[str, Any]:
    try:
        values = json.loads((folder / METRICS).read_text(encoding="utf-8"))
    except (ValueError, OSError, RecursionError) as fault:
        raise UserError(f"law={folder}: {METRICS} cannot be read ({type(fault).__name__})") from fault
    if not isinstance(values, dict):
        raise UserError(f"law={folder}: {METRICS} is not what a finished run leaves")
    return values


def _without_curves(metrics: Mapping[str, Any]) -> dict[str, Any]:
    values = {name: value for name, value in metrics.items() if name not in CURVES}
    scenes = values.get("scenes")
    if isinstance(scenes, list) and all(isinstance(scene, dict) for scene in scenes):
        values["scenes"] = [{k: v for k, v in scene.items() if k not in CURVES_OF_SCENE} for scene in scenes]
    return values
