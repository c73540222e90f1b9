"""Checkpoints that survive a kill: plain types, written whole or not at all, the one before kept beside."""

import logging
import pickle
from pathlib import Path
from typing import Any

import torch
from lightning.fabric.plugins.io.checkpoint_io import CheckpointIO

from pcnclaws.atomic import replaced_file

log = logging.getLogger(__name__)

LAST, PREVIOUS = "last.ckpt", "previous.ckpt"


class AtomicCheckpointIO(CheckpointIO):
    """Writes a file whole or not at all; reads plain types only, so that no file can run code."""

    def save_checkpoint(self, checkpoint: dict[str, Any], path: str | Path, storage_options: Any | None = None) -> None:
        with replaced_file(path, previous=Path(path).with_name(PREVIOUS)) as part:
            torch.save(checkpoint, part)

    def load_checkpoint(
        self, path: str | Path, map_location: Any | None = None, weights_only: bool | None = True
    ) -> dict[str, Any]:
        return torch.load(path, map_location=map_location or "cpu", weights_only=True)

    def remove_checkpoint(self, path: str | Path) -> None:
        Path(path).unlink(missing_ok=True)


def newest_checkpoint(folder: Path) -> Path | None:
    """The newest checkpoint of a folder that can be read whole; None if there is none.

    A damaged one is said and passed over.
    """
    for path in (folder / LAST, folder / PREVIOUS):
        if not path.exists():
            continue
        try:
            AtomicCheckpointIO().load_checkpoint(path)
        except (RuntimeError, EOFError, OSError, pickle.UnpicklingError, KeyError, ValueError) as fault:
            log.warning("%s is damaged and is passed over (%s)", path, type(fault).__name__)
        else:
            return path
    return None
