"""Weight files of models, safetensors: tensors and text, nothing that can run."""

import json
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor, nn

from pcnclaws.atomic import replaced_file
from pcnclaws.errors import UserError


def model_weights(model: nn.Module) -> dict[str, Tensor]:
    """Copies of all weights on the CPU; those of laws are named elasticity.* and plasticity.*."""
    return {name: weight.detach().cpu().clone() for name, weight in model.state_dict().items()}


def set_model_weights(model: nn.Module, weights: dict[str, Tensor], source: str) -> None:
    """Loads weights into a model; UserError naming `source` and the first weight that does not fit."""
    wanted = model.state_dict()
    for name in sorted(wanted.keys() | weights.keys()):
        if name not in weights:
            raise UserError(f"{source}: the weights do not fit the configuration: '{name}' is missing")
        if name not in wanted:
            raise UserError(f"{source}: the weights do not fit the configuration: '{name}' is not part of the law")
        if wanted[name].shape != weights[name].shape:
            raise UserError(
                f"{source}: the weights do not fit the configuration: '{name}' has shape "
                f"{list(weights[name].shape)}, the configuration asks for {list(wanted[name].shape)}"
            )
        if not bool(torch.isfinite(weights[name]).all()):
            raise UserError(f"{source}: '{name}' holds numbers that are not finite")
    model.load_state_dict(weights)


def write_weights(path: Path, weights: dict[str, Tensor], notes: dict[str, Any]) -> None:
    """Writes a weights file, whole or not at all. notes: plain values kept as JSON text in the file's header."""
    with replaced_file(path) as part:
        tensors = {name: weight.contiguous() for name, weight in weights.items()}
        part.write(save(tensors, {"pcnclaws": json.dumps(notes, sort_keys=True)}))


def read_weights(path: Path) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """Weights and notes of a weights file; UserError if it is missing, damaged or foreign."""
    if not path.is_file():
        raise UserError(f"{path} is missing; the training run is not finished or this is no run folder")
    try:
        with safe_open(path, framework="pt") as file:
            notes = json.loads((file.metadata() or {})["pcnclaws"])
            names = file.keys()
            weights = {name: file.get_tensor(name) for name in names}
    except (SafetensorError, OSError, KeyError, ValueError, TypeError, RecursionError) as fault:
        raise UserError(f"{path} is damaged or was not written by pcnclaws ({type(fault).__name__})") from fault
    if not isinstance(notes, dict):
        raise UserError(f"{path} was not written by pcnclaws")
    return weights, notes
