"""Checkpoints that survive a kill: plain types, written whole or not at all, the one before kept beside."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch
from lightning.fabric.plugins.io.checkpoint_io import CheckpointIO
from lightning.pytorch import Callback, LightningModule, Trainer

from pcnclaws.atomic import replaced_file
from pcnclaws.errors import CannotWrite, UserError

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


class Resumption(Callback):
    """Names a checkpoint that a run cannot go on from: what fails before the first step, fails for its sake.

    checkpoint  None for a run that starts anew
    """

    def __init__(self, checkpoint: Path | None) -> None:
        self._checkpoint, self._began = checkpoint, False

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        self._began = True

    @contextmanager
    def one_line_faults(self) -> Iterator[None]:
        """Around the fit; UserError of one line for a checkpoint of something else."""
        try:
            yield
        except (UserError, CannotWrite, OSError):
            raise
        except Exception as fault:
            if self._checkpoint is None or self._began:
                raise
            text = " ".join(str(fault).split())[:200]
            raise UserError(
                f"{self._checkpoint} does not fit this run ({type(fault).__name__}: {text}); accepted: a checkpoint "
                "that it left, or overwrite=true"
            ) from fault


def check_interval(checkpoint: Path) -> int:
    """Iterations between two checks of the run that left a checkpoint."""
    found = AtomicCheckpointIO().load_checkpoint(checkpoint)
    return int(found["global_step"]) // (int(found["epoch"]) + 1)


def newest_checkpoint(folder: Path) -> Path | None:
    """The newest checkpoint of a folder that can be read whole; None if there is none.

    A damaged one is said and passed over.
    """
    for path in (folder / LAST, folder / PREVIOUS):
        if not path.exists():
            continue
        try:
            found = AtomicCheckpointIO().load_checkpoint(path)
        except Exception as fault:  # zip and the reader of plain types raise whatever a damaged file makes them meet
            log.warning("%s is damaged and is passed over (%s)", path, type(fault).__name__)
            continue
        if isinstance(found, dict):
            return path
        log.warning("%s is no checkpoint of a run and is passed over", path)
    return None
